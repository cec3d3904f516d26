/*
 * Start of a Cortex-M with a floating-point unit, on the boards that QEMU imitates: QEMU has put code and
 * data where they belong, so that all there is to do is to turn the unit on and to enter the C library.
 */
#include <stdint.h>

typedef void (*handler)(void);

extern uint32_t board_stack[];
extern void _start(void) __attribute__((noreturn));
void board_reset(void) __attribute__((noreturn));
void board_fault(void) __attribute__((noreturn));

void board_reset(void)
{
    volatile uint32_t *const coprocessors = (volatile uint32_t *)0xE000ED88u;
    *coprocessors |= 0xFu << 20;
    __asm__ volatile("dsb\n\tisb" ::: "memory");
    _start();
}

/* Ends QEMU with an error: a fault must never look like a long computation. */
void board_fault(void)
{
    register uint32_t operation __asm__("r0") = 0x18u;
    register uint32_t reason __asm__("r1") = 0x20023u;
    __asm__ volatile("bkpt 0xAB" ::"r"(operation), "r"(reason) : "memory");
    for (;;) {
    }
}

__attribute__((section(".vectors"), used)) static const handler vectors[16] = {
    (handler)board_stack, board_reset, board_fault, board_fault, board_fault, board_fault, board_fault,
};
