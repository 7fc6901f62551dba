/* Ticks from stdin through a controller, torques and the last memory to stdout; or, built as a library, many at a time.
   NAME, the controller's prefix, and HEADER are given by the compiler's command line. */
#include <stdio.h>
#include <string.h>

#include HEADER

#define PASTE(a, b) a##_##b
#define JOINED(a, b) PASTE(a, b)
#define OF(what) JOINED(NAME, what)

typedef struct {
    OF(real) p[JOINTS];
    OF(real) v[JOINTS];
    OF(reference) reference;
} tick;

typedef struct {
    OF(real) torque[JOINTS];
} answer;

static OF(state) state;

unsigned begin(const OF(real) *p);
unsigned run(const tick *ticks, answer *answers, int count);
unsigned run_once(const OF(real) *p, const OF(real) *v, const OF(reference) *reference, OF(real) *torque);

unsigned begin(const OF(real) *p) { return OF(init)(&state, p); }

unsigned run(const tick *ticks, answer *answers, int count)
{
    unsigned seen = 0u;
    int k;
    for (k = 0; k < count; k++) {
        seen |= OF(step)(&state, &OF(default_gains), ticks[k].p, ticks[k].v, &ticks[k].reference, answers[k].torque);
    }
    return seen;
}

unsigned run_once(const OF(real) *p, const OF(real) *v, const OF(reference) *reference, OF(real) *torque)
{
    return OF(step)(&state, &OF(default_gains), p, v, reference, torque);
}

#ifndef LIBRARY
int main(void)
{
    OF(real) start[JOINTS];
    tick one;
    answer out;
    if (fread(start, sizeof start, 1, stdin) != 1 || begin(start) != 0u) {
        return 1;
    }
    while (fread(&one, sizeof one, 1, stdin) == 1) {
        (void)run(&one, &out, 1);
        (void)fwrite(&out, sizeof out, 1, stdout);
    }
    (void)fwrite(&state.memory[state.current & 1u], sizeof state.memory[0], 1, stdout);
    return 0;
}
#endif
