#!/usr/bin/python3
"""Two drives of the generic controller profile, served by pymodbus: nothing here is shared with lightrig's own server. A drive
is where it was told to be as soon as it is told. Every motion is printed: "unit 1 at 12345".

  pymodbus_drive.py tcp PORT high|low
  pymodbus_drive.py rtu DEVICE high|low
"""
import struct
import sys

from pymodbus.datastore import ModbusSequentialDataBlock, ModbusServerContext, ModbusSlaveContext
from pymodbus.server import StartSerialServer, StartTcpServer
from pymodbus.transaction import ModbusRtuFramer

KNOWN, TRIGGER, ENABLE, TARGET, POSITION, STATUS = 0x0000, 0x0010, 0x0011, 0x0100, 0x0200, 0x0202
READY, IN_POSITION, HOMED, ENABLED = 1, 4, 8, 32
MOVE, HOME = 1, 2


class Drive(ModbusSequentialDataBlock):
    def __init__(self, unit, order):
        super().__init__(0, [0] * 0x400)
        self.unit, self.order, self.trigger = unit, order, 0
        self.values[KNOWN] = 0x4C52
        self.values[STATUS] = READY | IN_POSITION
        self.place(777)

    def place(self, counts):
        words = struct.unpack(">HH", struct.pack(">i", counts))
        self.values[POSITION:POSITION + 2] = words if self.order == "high" else words[::-1]

    def target(self):
        words = self.values[TARGET:TARGET + 2]
        return struct.unpack(">i", struct.pack(">HH", *(words if self.order == "high" else words[::-1])))[0]

    def setValues(self, address, values):
        super().setValues(address, values)
        before, self.trigger = self.trigger, self.values[TRIGGER]
        rose = self.trigger & ~before
        if self.values[ENABLE]:
            self.values[STATUS] |= ENABLED
        if rose & HOME:
            self.place(0)
            self.values[STATUS] |= HOMED
        if rose & MOVE:
            self.place(self.target())
            print(f"unit {self.unit} at {self.target()}", flush=True)


def main():
    kind, where, order = sys.argv[1:4]
    inputs = ModbusSequentialDataBlock(0, [1] * 16)
    units = {unit: ModbusSlaveContext(hr=Drive(unit, order), di=inputs, zero_mode=True) for unit in (1, 2)}
    context = ModbusServerContext(slaves=units, single=False)
    if kind == "tcp":
        StartTcpServer(context=context, address=("127.0.0.1", int(where)))
    else:
        StartSerialServer(context=context, framer=ModbusRtuFramer, port=where, baudrate=115200, parity="N")


main()
