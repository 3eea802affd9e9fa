"""A tap on a gantry's wire: passes every byte on, and notes when a stop command passes. Run as a process of its own, so that its
clock readings wait for nobody: `wire_tap.py KIND LISTEN FAR` prints "ready", then one CLOCK_MONOTONIC time [s] per stop.

  modbus  LISTEN and FAR are ports of 127.0.0.1. A stop is the first write of the generic profile's [stop.trigger]: the control word with its stop bit set.
  rtu     as grbl below; a stop is the same write in an RTU frame.
  grbl    FAR is a tty; LISTEN is a path that becomes a link to the tap's own pty. A stop is a feed hold or a soft reset.
"""
import os
import select
import socket
import sys
import termios
import time
import tty

CONTROL, STOP = 0x0010, 0x0004


def is_modbus_stop(pdu):
    """Function code and data: a single write of the control word, or a write of several from it on."""
    if len(pdu) >= 5 and pdu[0] == 6:
        return int.from_bytes(pdu[1:3], "big") == CONTROL and bool(int.from_bytes(pdu[3:5], "big") & STOP)
    if len(pdu) >= 8 and pdu[0] == 16:
        return int.from_bytes(pdu[1:3], "big") == CONTROL and bool(int.from_bytes(pdu[6:8], "big") & STOP)
    return False


def stops_in(kind, data):
    if kind == "modbus":  # MBAP: transaction, protocol, length, unit
        while len(data) >= 7:
            length = int.from_bytes(data[4:6], "big")
            if is_modbus_stop(data[7:6 + length]):
                return True
            data = data[6 + length:]
        return False
    if kind == "rtu":
        return is_modbus_stop(data[1:])
    return b"!" in data or b"\x18" in data


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
            if fd == near and stops_in(kind, data):
                print(f"{now:.6f}", flush=True)


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
