/* A libmodbus server that plays the device of drivers/emulator.toml, and one with functions 6 and 4 beside it. */
#include <modbus/modbus.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

static double now_ms(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return t.tv_sec * 1e3 + t.tv_nsec / 1e6;
}

int main(int argc, char **argv) {
    if (argc < 3) return 2;
    int tcp = !strcmp(argv[1], "tcp"), listener = -1;
    modbus_t *bus = tcp ? modbus_new_tcp("127.0.0.1", atoi(argv[2])) : modbus_new_rtu(argv[2], 115200, 'N', 8, 1);
    modbus_mapping_t *map = modbus_mapping_new(0, 0, 64, 64);
    uint16_t *r = map->tab_registers, query_write;
    uint8_t query[MODBUS_TCP_MAX_ADU_LENGTH];
    int tripped = 0;
    double seen = now_ms();
    r[32] = 18518;
    modbus_set_slave(bus, 1);
    if (tcp) {
        listener = modbus_tcp_listen(bus, 2);
        modbus_tcp_accept(bus, &listener);
    } else if (modbus_connect(bus)) {
        return 1;
    }
    for (;;) {
        int n = modbus_receive(bus, query);
        if (n < 0) {
            if (tcp) modbus_tcp_accept(bus, &listener);
            continue;
        }
        if (n == 0) continue;
        const uint8_t *pdu = query + modbus_get_header_length(bus);
        int write_at = -1, values = 0;
        if (pdu[0] == 6) { write_at = pdu[1] << 8 | pdu[2]; values = 3; }
        if (pdu[0] == 16) { write_at = pdu[1] << 8 | pdu[2]; values = 6; }
        if (pdu[0] == 23) { write_at = pdu[5] << 8 | pdu[6]; values = 10; }
        query_write = write_at < 0 ? 0 : pdu[values] << 8 | pdu[values + 1];
        if (r[16] && now_ms() - seen > r[16]) tripped = 1;
        seen = now_ms();
        if (write_at == 17 && query_write == 1) tripped = 0;
        if (write_at == 0) r[4] = tripped ? 0 : query_write;
        r[2] = tripped ? 9 : 1;
        r[3]++;
        r[5] = 4000 + r[4];
        map->tab_input_registers[0] = 4000 + r[4];
        map->tab_input_registers[1] = r[4];
        modbus_reply(bus, query, n, map);
    }
}
