"""A pymodbus server that plays the device of drivers/emulator.toml, and one with functions 6 and 4 beside it."""

import asyncio
import sys
import time

from pymodbus.datastore import ModbusDeviceContext, ModbusSequentialDataBlock, ModbusServerContext
from pymodbus.framer import FramerType
from pymodbus.server import StartAsyncSerialServer, StartAsyncTcpServer

state = {"setpoint": 0, "seen": time.monotonic(), "tripped": False, "watchdog": 0, "conversions": 0}


def visited():
    now = time.monotonic()
    if state["watchdog"] and now - state["seen"] > state["watchdog"] / 1000:
        state["tripped"], state["setpoint"] = True, 0
    state["seen"] = now
    state["conversions"] = (state["conversions"] + 1) & 0xFFFF


class Holding(ModbusSequentialDataBlock):
    def setValues(self, address, values):
        visited()
        super().setValues(address, values)
        at = {address - 1 + i: v for i, v in enumerate(values)}
        state["watchdog"] = at.get(16, state["watchdog"])
        if at.get(17) == 1:
            state["tripped"] = False
        if 0 in at:
            state["setpoint"] = 0 if state["tripped"] else at[0]

    def getValues(self, address, count=1):
        visited()
        s = state["setpoint"]
        for register, value in [(0, s), (2, 9 if state["tripped"] else 1), (3, state["conversions"]), (4, s), (5, 4000 + s)]:
            super().setValues(register + 1, [value])
        return super().getValues(address, count)


class Input(ModbusSequentialDataBlock):
    def getValues(self, address, count=1):
        visited()
        super().setValues(1, [4000 + state["setpoint"], state["setpoint"]])
        return super().getValues(address, count)


async def main():
    kind, place = sys.argv[1:3]
    holding = Holding(1, [0] * 64)
    ModbusSequentialDataBlock.setValues(holding, 33, [18518])
    context = ModbusServerContext(ModbusDeviceContext(hr=holding, ir=Input(1, [0] * 64)), single=True)
    if kind == "tcp":
        host, port = place.rsplit(":", 1)
        await StartAsyncTcpServer(context, address=(host, int(port)))
    else:
        await StartAsyncSerialServer(context, port=place, baudrate=115200, framer=FramerType.RTU)


asyncio.run(main())
