#!/usr/bin/python3
"""pymodbus as the master of lightrig's simulated controller (generic profile): enables, homes and moves both drives, reads where
they are, switches the lamp, and provokes the exceptions. Prints "unit 1 at 12345" as it reads it, then "lamp 500"; exits 1 with
what was wrong.

  pymodbus_client.py tcp PORT high|low COUNTS1 COUNTS2
  pymodbus_client.py rtu DEVICE high|low COUNTS1 COUNTS2
"""
import struct
import sys
import time

from pymodbus.client import ModbusSerialClient, ModbusTcpClient
from pymodbus.transaction import ModbusRtuFramer


def words_of(counts, order):
    words = struct.unpack(">HH", struct.pack(">i", counts))
    return list(words if order == "high" else words[::-1])


def counts_of(words, order):
    return struct.unpack(">i", struct.pack(">HH", *(words if order == "high" else words[::-1])))[0]


def main():
    kind, where, order = sys.argv[1:4]
    targets = {1: int(sys.argv[4]), 2: int(sys.argv[5])}
    if kind == "tcp":
        client = ModbusTcpClient("127.0.0.1", port=int(where))
    else:
        client = ModbusSerialClient(port=where, framer=ModbusRtuFramer, baudrate=115200, parity="N", timeout=2)
    assert client.connect(), "no connection"

    def good(answer):
        assert not answer.isError(), answer
        return answer

    def pulse(unit, bit):
        for value in (0, bit, 0):
            good(client.write_register(0x0010, value, slave=unit))

    def wait(unit, mask, value):
        for _ in range(400):
            status = good(client.read_holding_registers(0x0202, 1, slave=unit)).registers[0]
            if status & mask == value:
                return
            time.sleep(0.02)
        sys.exit(f"unit {unit} never came to {value:#x} of {mask:#x}; it says {status:#x}")

    for unit in targets:
        assert good(client.read_holding_registers(0x0000, 1, slave=unit)).registers == [0x4C52]
        good(client.write_register(0x0011, 1, slave=unit))
    for unit in targets:
        pulse(unit, 2)
    for unit in targets:
        wait(unit, 0x000A, 0x0008)  # homed and not moving
    for unit, counts in targets.items():
        block = words_of(counts, order) + words_of(5000, order) * 3
        good(client.write_registers(0x0100, block, slave=unit))
        pulse(unit, 1)
    for unit in targets:
        wait(unit, 0x0006, 0x0004)  # in position and not moving
        print(f"unit {unit} at {counts_of(good(client.read_holding_registers(0x0200, 2, slave=unit)).registers, order)}")
    good(client.write_register(0x0300, 500, slave=1))
    print(f"lamp {good(client.read_holding_registers(0x0300, 1, slave=1)).registers[0]}")
    assert good(client.read_discrete_inputs(0, 2, slave=1)).bits[:2] == [True, True], "door or chain open"
    assert client.read_holding_registers(0x5000, 1, slave=1).exception_code == 2, "an address that is not there"
    assert client.read_exception_status(slave=1).exception_code == 1, "a function that is not there"


main()
