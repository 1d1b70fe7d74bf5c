/* A loop as one writes it in C with libmodbus: absolute deadlines, SCHED_FIFO, locked memory; function 23 in every slot on the map of
 * drivers/emulator-tcp.toml. Prints the 99th percentile of the lateness [us], slots, missed slots, losses and replies of an older slot.
 * modbus_pace PORT SECONDS RATE_HZ PRIORITY */
#include <errno.h>
#include <modbus/modbus.h>
#include <sched.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <time.h>

static double now_s(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return t.tv_sec + t.tv_nsec * 1e-9;
}

static void sleep_until(double at_s) {
    struct timespec t = { (time_t)at_s, (long)((at_s - (time_t)at_s) * 1e9) };
    while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &t, NULL) == EINTR) {}
}

static int by_size(const void *a, const void *b) {
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

int main(int argc, char **argv) {
    if (argc < 5) return 2;
    double period_s = 1.0 / atof(argv[3]);
    int slots = (int)(atof(argv[2]) / period_s + 0.5);
    struct sched_param priority = { .sched_priority = atoi(argv[4]) };
    int fifo = sched_setscheduler(0, SCHED_FIFO, &priority) == 0;
    mlockall(MCL_CURRENT | MCL_FUTURE);
    prctl(PR_SET_TIMERSLACK, 1);
    modbus_t *bus = modbus_new_tcp("127.0.0.1", atoi(argv[1]));
    modbus_set_slave(bus, 1);
    modbus_set_response_timeout(bus, 0, 6000); /* the profile's timeout */
    if (modbus_connect(bus) || modbus_write_register(bus, 16, 200) < 0 || modbus_write_register(bus, 17, 1) < 0) {
        fprintf(stderr, "%s\n", modbus_strerror(errno));
        return 1;
    }
    double *late_s = calloc(slots, sizeof *late_s), origin_s = now_s() + 2 * period_s;
    int taken = 0, missed = 0, lost = 0, stale = 0;
    uint16_t token = 1;
    for (int k = 0; k < slots; k++) {
        double begin_s = origin_s + k * period_s;
        sleep_until(begin_s);
        double lateness_s = now_s() - begin_s;
        if (lateness_s > period_s - 0.003) { missed++; continue; }
        late_s[taken++] = lateness_s;
        modbus_flush(bus); /* a reply that came too late */
        float ampere = 0.3f;
        uint32_t bits;
        memcpy(&bits, &ampere, 4);
        uint16_t out[3] = { bits >> 16, bits & 0xffff, token = token % 65535 + 1 }, in[9];
        if (modbus_write_and_read_registers(bus, 0, 3, out, 0, 9, in) != 9) {
            lost++;
            modbus_flush(bus);
        } else if (in[2] != token) {
            stale++;
        }
    }
    uint16_t zero[3] = { 0, 0, token }, in[9];
    modbus_write_and_read_registers(bus, 0, 3, zero, 0, 9, in);
    qsort(late_s, taken, sizeof *late_s, by_size);
    printf("%.3f %d %d %d %d %s\n", taken ? late_s[(int)(0.99 * (taken - 1) + 0.5)] * 1e6 : -1.0, taken, missed, lost, stale, fifo ? "fifo" : "no-fifo");
    return 0;
}
