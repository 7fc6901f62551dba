/* Ticks of a controller on a bare Cortex-M in qemu: instructions by SysTick (25 MHz, with -icount shift=0 40 each),
   stack by a pattern, the largest difference from Python; told over semihosting. */
#include <stdint.h>
#include <string.h>

#include HEADER
#include "vectors.h"

#define PASTE(a, b) a##_##b
#define JOINED(a, b) PASTE(a, b)
#define OF(what) JOINED(NAME, what)
#define SYST ((volatile uint32_t *)0xE000E010u)
#define CPACR (*(volatile uint32_t *)0xE000ED88u)
#define PATTERN 0xA5A5A5A5u
#define PAINTED 4096u /* words */

extern uint32_t stack_top;
int main(void);
void reset(void);

__attribute__((section(".vectors"), used)) static void *const vectors[] = {&stack_top, (void *)reset};

static OF(state) state;

static void host(int operation, const void *argument)
{
    register int r0 __asm__("r0") = operation;
    register const void *r1 __asm__("r1") = argument;
    __asm__ volatile("bkpt 0xAB" : "+r"(r0) : "r"(r1) : "memory");
}

static void say(const char *what, uint32_t value)
{
    char text[64];
    char digits[11];
    int n = 0;
    int k = 0;
    while (what[k] != '\0') {
        text[k] = what[k];
        k++;
    }
    text[k++] = ' ';
    do {
        digits[n++] = (char)('0' + value % 10u);
        value /= 10u;
    } while (value != 0u);
    while (n > 0) {
        text[k++] = digits[--n];
    }
    text[k++] = '\n';
    text[k] = '\0';
    host(0x04, text); /* SYS_WRITE0 */
}

__attribute__((noinline)) static uint32_t used_stack(void)
{
    volatile uint32_t *here = (volatile uint32_t *)__builtin_frame_address(0) - 16;
    uint32_t k = PAINTED;
    while (k > 0u && here[-(int)k] == PATTERN) {
        k--;
    }
    return 4u * (k + 16u);
}

__attribute__((noinline)) static void paint(void)
{
    volatile uint32_t *here = (volatile uint32_t *)__builtin_frame_address(0) - 16;
    uint32_t k;
    for (k = 1u; k <= PAINTED; k++) {
        here[-(int)k] = PATTERN;
    }
}

void reset(void)
{
    CPACR |= 0xFu << 20; /* the floating-point unit, before any of its registers is touched */
    __asm__ volatile("dsb\nisb");
    (void)main();
    {
        static const uint32_t done[2] = {0x20026u, 0u};
        host(0x20, done); /* SYS_EXIT_EXTENDED */
    }
    for (;;) {
    }
}

int main(void)
{
    OF(real) torque[JOINTS];
    uint32_t most = 0u;
    uint32_t sum = 0u;
    uint32_t empty;
    double worst = 0.0;
    int k;
    int j;
    SYST[1] = 0xFFFFFFu;
    SYST[2] = 0u;
    SYST[0] = 5u;
    if (OF(init)(&state, VECTORS_START) != 0u) {
        say("init_failed", 1u);
        return 1;
    }
    empty = SYST[2];
    empty = (empty - SYST[2]) & 0xFFFFFFu;
    paint();
    for (k = 0; k < VECTORS; k++) {
        const uint32_t before = SYST[2];
        (void)OF(step)(&state, &OF(default_gains), VECTOR[k].p, VECTOR[k].v, &VECTOR[k].reference, torque);
        {
            const uint32_t taken = ((before - SYST[2]) & 0xFFFFFFu) - empty;
            most = taken > most ? taken : most;
            sum += taken;
        }
        for (j = 0; j < JOINTS; j++) {
            const double off = (double)torque[j] - VECTOR[k].torque[j];
            worst = off > worst ? off : (-off > worst ? -off : worst);
        }
    }
    say("stack", used_stack());
    say("instructions_mean", 40u * sum / (uint32_t)VECTORS);
    say("instructions_most", 40u * most);
    say("nano_newton_metres_off", worst < 4.0 ? (uint32_t)(1e9 * worst) : 4000000000u);
    return 0;
}
