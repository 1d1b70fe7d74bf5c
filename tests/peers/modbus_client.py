"""A pymodbus client against the emulator: functions 3, 6, 16, 23 and the exceptions, on TCP or on a serial line."""

import sys

from pymodbus.client import ModbusSerialClient, ModbusTcpClient

kind, place = sys.argv[1:3]
if kind == "tcp":
    host, port = place.rsplit(":", 1)
    client = ModbusTcpClient(host, port=int(port), timeout=2)
else:
    client = ModbusSerialClient(place, baudrate=115200, timeout=2)
assert client.connect(), place

identity = client.read_holding_registers(32, count=1, device_id=1)
assert identity.registers == [18518], identity
reply = client.write_register(16, 200, device_id=1)
assert not reply.isError(), reply
reply = client.write_registers(17, [1], device_id=1)
assert not reply.isError(), reply
for token in range(1, 30):
    reply = client.readwrite_registers(read_address=0, read_count=6, write_address=0, values=[2500, token], device_id=1)
    assert not reply.isError(), reply
    assert reply.registers[:3] == [2500, token, 1], reply.registers
    assert reply.registers[4] == 2500, reply.registers
refused = client.read_holding_registers(900, count=1, device_id=1)
assert refused.isError() and refused.exception_code == 2, refused
reply = client.write_registers(0, [0, 0], device_id=1)
assert not reply.isError(), reply
print("ok")
