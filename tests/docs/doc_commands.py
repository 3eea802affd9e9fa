"""What stands in the documents' code blocks, and what becomes of it: every command line is run, or stands here with the test that runs
it or the reason why none can. A line that is in neither makes the test fail, and so does an entry that no document has any more.
first_rig.md is no part of this: its commands are all run, in order."""
import pathlib
import re

ROOT = pathlib.Path(__file__).resolve().parent.parent.parent

# Blocks that hold no command, by document and the beginning of their first line.
NO_COMMANDS = {
    ("hardware.md", "[controller]"): "a controller profile",
    ("demo_truths.md", "truths="): "the figures that bench/demo_truths prints",
    ("controller_profile.md", "counts = (axis position"): "formulas",
    ("demo_truths.md", "truth  "): "a table that bench/demo_truths prints",
    ("method.md", "100 · ‖ln"): "a formula",
    ("planning.md", "bytes        = 8"): "formulas",
    ("results.md", "seen = 100"): "a formula",
    ("results.md", "held-out = seen"): "a formula",
    ("rig_file.md", "rig.toml:27:1: error"): "what a command prints",
    ("session_folder.md", "20261122T031500Z-brass-3/"): "a folder",
    ("session_folder.md", "journal  = { line }"): "a grammar",
    ("simulate.md", "EFFECT [wire"): "the grammar of faults; tests/sim/faults_test.cpp holds it to its word",
    ("simulate.md", "wire   fault"): "a table that tests/fault_campaign prints",
    ("operations.md", "[Service]\nExecStart="): "a drop-in; SystemdUnits.ThePanelsDropInIsTheServiceWithAPort holds it to the unit",
    ("README.md", '[materials]\nsource = "/data/merl"'): "no measured data is shipped",
}

# Tables of a rig file, by document and first line: taken into the demo's rig file, `lightrig check` must accept them.
RIG_TABLES = {("operations.md", "[pause.packet_loss]"), ("README.md", '[materials]\nsource = "builtin"')}

NEEDS_ROOT = "changes the machine as root"
NEEDS_CARD = "needs root and a network card with a camera"
# Commands that this test cannot run: why, or a file and what it must hold, where another test runs the same.
NOT_RUN = {
    "CONTRIBUTING.md": {
        "scripts/test": "it runs this test",
        "LIGHTRIG_DEMAND_ALL= scripts/test": "it runs this test",
        "cmake --preset dev && cmake --build --preset dev && ctest --preset dev": "builds everything, and runs this test",
        "cmake --preset asan …": "no whole command; builds everything",
        "cmake --preset tsan …": "no whole command; builds everything",
        'cmake --preset asan -DCMAKE_CXX_COMPILER=clang++ "-DCMAKE_CXX_FLAGS=-w" …': "no whole command; builds everything",
        "tests/fault_campaign": ("tests/CMakeLists.txt", "COMMAND fault_campaign --count 12"),
    },
    "README.md": {
        "scripts/demo": "builds the tree; its session is that of docs/first_rig.md",
        "scripts/test": "it runs this test",
    },
    "hardware.md": {
        "ip addr add 192.168.10.1/24 dev enp3s0": NEEDS_CARD,
        "ip link set dev enp3s0 up mtu 9000": NEEDS_CARD,
        "sysctl -w net.core.rmem_max=8388608": NEEDS_ROOT,
        "ethtool -G enp3s0 rx 4096": NEEDS_CARD,
        "arv-tool-0.8 --address=192.168.10.30 control DeviceModelName": NEEDS_CARD,
    },
    "materials.md": {
        "cmake --build build/release --target basis_coverage && build/release/basis_coverage": "takes minutes, and data not shipped",
    },
    "operations.md": {
        "cmake --preset release -DCMAKE_INSTALL_PREFIX=/usr && cmake --build build/release": "builds everything",
        "sudo cmake --install build/release": ("tests/package_test", '"cpack", "-G", "DEB"'),
        "sudo systemd-sysusers && sudo systemd-tmpfiles --create && sudo udevadm control --reload": NEEDS_ROOT,
        "sudo adduser $USER lightrig": NEEDS_ROOT,
        "sudo systemctl enable --now lightrigd.socket lightrigd.service": ("tests/package_test", "as systemd starts it"),
        "lightrig commission": ("tests/operator_test", '"commission", "--yes"'),
        "lightrig devices /etc/lightrig/rig.toml": "opens real devices, and fails where there are none",
    },
    "simulate.md": {
        "lightrig simulate RIG [SESSION] [--fault FILE] [--truth FILE] [--record FILE] [--seed N] [--tell-halts] [--json]":
            ("tests/cli/wire_session_test.cpp", "exec {} simulate {} --json --record"),
        "lightrig simulate config/wire_modbus_tcp.toml": ("tests/cli/wire_session_test.cpp", "exec {} simulate {} --json --record"),
        "lightrigd --rig config/wire_modbus_tcp.toml --socket /tmp/rig.sock": ("tests/cli/wire_session_test.cpp", "--rig {} {} --socket {}"),
        "export LIGHTRIG_SOCKET=/tmp/rig.sock": "the socket's name for the next line",
        "lightrig arm && lightrig start --wait": ("tests/cli/wire_session_test.cpp", 'run("start --wait")'),
        "env LD_PRELOAD=libumockdev-preload.so.0 UMOCKDEV_DIR=/tmp/umockdev.XXXXXX lightrigd --rig config/wire_usb.toml …":
            ("tests/cli/wire_session_test.cpp", '"wire_usb.toml"'),
    },
    "study.md": {
        "lightrig study --objects sphere bunny --meshes DIR --materials DIR -o OUT": "takes minutes, and data not shipped",
        "lightrig study --table1 --meshes DIR --materials DIR -o OUT": "takes hours, and data not shipped",
        'lightrig study --table1 --meshes "$MESHES" --materials "$MATERIALS" --shard "$SLURM_ARRAY_TASK_ID/16" '
        '-o "study-$SLURM_ARRAY_TASK_ID"': "a cluster's job",
    },
}

# Run here, in this order of documents; the words on the left become those on the right.
RUN = {
    "README.md": ["mkdir -p my_rig && cp -r config/demo.toml config/controllers my_rig/"],
    "rig_file.md": ["lightrig check RIG [SESSION]", "lightrig check RIG [SESSION] --print"],
    "operations.md": ["lightrig check /etc/lightrig/rig.toml --print", "lightrig dry-run /etc/lightrig/rig.toml", "lightrig status",
                      'lightrig lock --note "commissioning"', "lightrig arm && lightrig home",
                      "lightrig snap --exposure 0.01 --lamp -o look.png", "lightrig start session.toml --wait", "lightrig unlock"],
    "control_api.md": ["curl --unix-socket /run/lightrig/control.sock http://localhost/v1/status",
                       "curl --unix-socket /run/lightrig/control.sock -X POST http://localhost/v1/abort -H 'X-Lightrig: 1' "
                       "-H 'Content-Type: application/json' -d '{}'"],
}


def blocks_of(text):
    """The code blocks of a document, indented or fenced, each as its lines without the indent. A paragraph between ends a block, a
    blank line does not; an indented line under a paragraph or an item goes on with it."""
    blocks, block, fenced, after_blank = [], [], False, True
    for line in text.splitlines():
        if line.lstrip().startswith("```"):
            fenced = not fenced
            blocks, block = blocks + [block], []
        elif fenced or (re.match(r" {4,}\S", line) and (block or after_blank)):
            block.append(line.strip())
        elif line.strip():
            blocks, block = blocks + [block], []
        after_blank = not line.strip()
    return [b for b in blocks + [block] if b]


def commands_in(block):
    """A block's commands: lines that go on with a backslash joined, comments and an ampersand at the end left out."""
    joined = re.sub(r"\s*\\\s*\n\s*", " ", "\n".join(block))
    for line in joined.splitlines():
        line = re.split(r"\s+#\s|^#|\s{3,}(?=[a-z])", line)[0].strip()
        line = re.sub(r"^bench: ", "", line)
        line = re.sub(r"\s*&$", "", line)
        if line:
            yield line


def documents():
    names = [p for p in sorted((ROOT / "docs").glob("*.md")) if p.name != "first_rig.md"]
    return [*names, ROOT / "README.md", ROOT / "CONTRIBUTING.md"]


def account():
    """What is wrong with the tables above: commands that are not in them, entries that are in no document, tests that do not hold what
    they are named for. And the tables of rig files found."""
    failures, tables, met, known = [], [], set(), set(NO_COMMANDS) | RIG_TABLES
    for document in documents():
        name = document.name
        for block in blocks_of(document.read_text()):
            text = "\n".join(block)
            # The longest beginning: two blocks may begin alike.
            mark = max((m for m in known if m[0] == name and text.startswith(m[1])), key=lambda m: len(m[1]), default=None)
            if mark:
                met.add(mark)
                if mark in RIG_TABLES:
                    tables.append((name, text))
                continue
            for command in commands_in(block):
                met.add((name, command))
                if command not in NOT_RUN.get(name, {}) and command not in RUN.get(name, []):
                    failures.append(f"{name}: no test runs '{command}': let tests/docs/doc_commands.py run it, or say there why not")
    known |= {(name, command) for part in (NOT_RUN, RUN) for name, commands in part.items() for command in commands}
    failures += [f"tests/docs/doc_commands.py: {name} no longer holds '{command}'" for name, command in sorted(known - met)]
    for name, commands in NOT_RUN.items():
        for command, why in commands.items():
            if isinstance(why, tuple) and why[1] not in (ROOT / why[0]).read_text():
                failures.append(f"{name}: {why[0]} does not run '{command}': it lacks {why[1]}")
    return failures, tables
