/* A valve of other physics than the library's, written by hand: magnetic force over the square of a lagging current, dry
   friction as a play, and a chamber that fills through an orifice. With the functions of FMI 2.0 and 3.0, or as a program.
   Built with -DHANG, -DCRASH, -DPRINTS or -DREFUSES it misbehaves. */
#include <math.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>

typedef struct { double command_a, coil_a, seat_bar, pressure_bar, time_s; } Valve;

static double wanted(double i) { return 34.0 * i * i / (0.22 + i * i) - 0.8; }

static void settle(Valve *v) { v->coil_a = v->command_a; v->seat_bar = v->pressure_bar = wanted(v->coil_a); }

static void run(Valve *v, double for_s) {
    const int steps = (int)(for_s / 1e-4 + 0.5);
    const double play_bar = 0.35;
    for (int k = 0; k < steps; k++) {
        v->coil_a += 1e-4 / 0.006 * (v->command_a - v->coil_a);
        const double want = wanted(v->coil_a);
        if (want > v->seat_bar + play_bar) v->seat_bar = want - play_bar;
        if (want < v->seat_bar - play_bar) v->seat_bar = want + play_bar;
        const double d = v->seat_bar - v->pressure_bar;
        const double rate = 150.0 * d / sqrt(fabs(d) + 0.05);
        v->pressure_bar += 1e-4 * rate;
        v->time_s += 1e-4;
    }
}

static int step(Valve *v, double for_s) {
#ifdef PRINTS
    printf("a model may print what it likes\n");
#endif
#ifdef CRASH
    if (v->time_s > 1.0) *(volatile int *)8 = 1;
#endif
#ifdef HANG
    while (v->time_s > 1.0) v->time_s += 1e-9;
#endif
#ifdef REFUSES
    if (v->time_s > 1.0) return 3;
#endif
    run(v, for_s);
    return 0;
}

#ifdef PROGRAM
int main(void) {
    Valve v = {0};
    double i, dt = 0.01;
    for (int k = 0; scanf("%lf", &i) == 1; k++) {
        if (k == 0) { v.command_a = i; settle(&v); } else run(&v, dt);
        printf("%.17g\n", v.pressure_bar);
        v.command_a = i;
    }
    return 0;
}
#endif

/* The description gives mA and Pa. */
static int set(Valve *v, const uint32_t *r, size_t n, const double *x) {
    for (size_t k = 0; k < n; k++) { if (r[k] != 7) return 3; v->command_a = x[k] / 1000.0; }
    return 0;
}
static int get(Valve *v, const uint32_t *r, size_t n, double *x) {
    for (size_t k = 0; k < n; k++) { if (r[k] != 9) return 3; x[k] = v->pressure_bar * 1e5; }
    return 0;
}

void *fmi2Instantiate(const char *name, int type, const char *guid, const char *where, const void *calls, int visible, int logging) {
    (void)name; (void)type; (void)guid; (void)where; (void)calls; (void)visible; (void)logging;
    return calloc(1, sizeof(Valve));
}
int fmi2SetupExperiment(void *v, int t, double tol, double from, int e, double to) { (void)v; (void)t; (void)tol; (void)from; (void)e; (void)to; return 0; }
int fmi2EnterInitializationMode(void *v) { (void)v; return 0; }
int fmi2ExitInitializationMode(void *v) { settle(v); return 0; }
int fmi2SetReal(void *v, const uint32_t *r, size_t n, const double *x) { return set(v, r, n, x); }
int fmi2GetReal(void *v, const uint32_t *r, size_t n, double *x) { return get(v, r, n, x); }
int fmi2DoStep(void *v, double now, double for_s, int keep) { (void)now; (void)keep; return step(v, for_s); }
int fmi2Terminate(void *v) { (void)v; return 0; }
void fmi2FreeInstance(void *v) { free(v); }

void *fmi3InstantiateCoSimulation(const char *name, const char *token, const char *where, bool visible, bool logging, bool events,
                                  bool early, const uint32_t *needed, size_t n, void *environment, void *log, void *update) {
    (void)name; (void)token; (void)where; (void)visible; (void)logging; (void)events; (void)early; (void)needed; (void)n; (void)environment; (void)log; (void)update;
    return calloc(1, sizeof(Valve));
}
int fmi3EnterInitializationMode(void *v, bool t, double tol, double from, bool e, double to) { (void)v; (void)t; (void)tol; (void)from; (void)e; (void)to; return 0; }
int fmi3ExitInitializationMode(void *v) { settle(v); return 0; }
int fmi3SetFloat64(void *v, const uint32_t *r, size_t n, const double *x, size_t m) { (void)m; return set(v, r, n, x); }
int fmi3GetFloat64(void *v, const uint32_t *r, size_t n, double *x, size_t m) { (void)m; return get(v, r, n, x); }
int fmi3DoStep(void *v, double now, double for_s, bool keep, bool *event, bool *end, bool *early, double *last) {
    (void)keep; *event = *end = *early = false; *last = now + for_s;
    return step(v, for_s);
}
int fmi3Terminate(void *v) { (void)v; return 0; }
void fmi3FreeInstance(void *v) { free(v); }
