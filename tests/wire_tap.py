"""A tap on a gantry's wire: passes every byte on, and notes when a stop command passes, or one that begins a motion. Run as a process of its
own, so that its clock readings wait for nobody: `wire_tap.py KIND LISTEN FAR` prints "ready", then "stop" or "go" and a CLOCK_MONOTONIC time [s]
for each.

  modbus  LISTEN and FAR are ports of 127.0.0.1. A stop is the first write of the generic profile's [stop.trigger]: the control word with its
          stop bit set; a motion begins with its start or its homing bit.
  rtu     as grbl below; stops and beginnings are the same writes in RTU frames.
  grbl    FAR is a tty; LISTEN is a path that becomes a link to the tap's own pty. A stop is a feed hold or a soft reset; what begins is $H or a line of G1.
"""
import os
import select
import socket
import sys
import termios
import time
import tty

CONTROL, START, HOME, STOP = 0x0010, 0x0001, 0x0002, 0x0004


def told_modbus(pdu):
    """Function code and data: a single write of the control word, or a write of several from it on."""
    at = {6: 3, 16: 6}.get(pdu[0] if pdu else 0)
    if at is None or len(pdu) < at + 2 or int.from_bytes(pdu[1:3], "big") != CONTROL:
        return None
    word = int.from_bytes(pdu[at:at + 2], "big")
    return "stop" if word & STOP else "go" if word & (START | HOME) else None


def told(kind, data):
    """What these bytes command, all of them read."""
    if kind == "modbus":  # MBAP: transaction, protocol, length, unit
        words = set()
        while len(data) >= 7:
            length = int.from_bytes(data[4:6], "big")
            words.add(told_modbus(data[7:6 + length]))
            data = data[6 + length:]
        return "stop" if "stop" in words else "go" if "go" in words else None
    if kind == "rtu":
        return told_modbus(data[1:])
    return "stop" if b"!" in data or b"\x18" in data else "go" if b"$H" in data or b"G1" in data else None


def raw(fd):
    tty.setraw(fd, termios.TCSANOW)


def pass_on(kind, near, far):
    """Until either side ends."""
    while True:
        ready, _, _ = select.select([near, far], [], [])
        for fd in ready:
            try:
                data = os.read(fd, 4096)
            except OSError:
                return
            now = time.monotonic()
            if not data:
                return
            os.write(far if fd == near else near, data)
            what = told(kind, data) if fd == near else None
            if what:
                print(f"{what} {now:.6f}", flush=True)


def main():
    kind, listen, far = sys.argv[1:]
    if kind == "modbus":
        server = socket.create_server(("127.0.0.1", int(listen)))
        print("ready", flush=True)
        while True:
            near, _ = server.accept()
            there = socket.create_connection(("127.0.0.1", int(far)))
            for s in (near, there):
                s.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            if os.fork() == 0:
                pass_on(kind, near.fileno(), there.fileno())
                os._exit(0)
            near.close()
            there.close()
    there = os.open(far, os.O_RDWR | os.O_NOCTTY)
    raw(there)
    master, slave = os.openpty()  # the slave stays open here: a pty that nobody holds hangs up
    raw(slave)
    if os.path.islink(listen):
        os.unlink(listen)
    os.symlink(os.ttyname(slave), listen)
    print("ready", flush=True)
    pass_on(kind, master, there)


main()
