/* What a library for Windows takes from MinGW beside Windows' own C library. Zig links it in its place, as MinGW takes a
   minute to compile; without builtins, or sincos would call itself. */
#include <stdint.h>

double sin(double x);
double cos(double x);

void sincos(double x, double *sine, double *cosine)
{
    *sine = sin(x);
    *cosine = cos(x);
}

/* The kinds of <math.h>: 0x100 what is no number, 0x400 normal, both infinite, 0x4000 zero, with normal subnormal. */
int __fpclassify(double x)
{
    const union {
        double number;
        uint64_t bits;
    } seen = {x};
    const uint64_t exponent = seen.bits >> 52 & 0x7FF, fraction = seen.bits << 12;
    if (exponent == 0x7FF)
        return fraction ? 0x100 : 0x500;
    return exponent ? 0x400 : fraction ? 0x4400 : 0x4000;
}

/* Touches each page of a large frame in turn, as the system wants; the size is in rax, and all registers stay. */
__asm__(".globl ___chkstk_ms\n"
        "___chkstk_ms:\n"
        "push %rcx\n push %rax\n lea 24(%rsp), %rcx\n"
        "1: cmp $0x1000, %rax\n jb 2f\n sub $0x1000, %rcx\n orl $0, (%rcx)\n sub $0x1000, %rax\n jmp 1b\n"
        "2: sub %rax, %rcx\n orl $0, (%rcx)\n pop %rax\n pop %rcx\n ret\n");

int DllMainCRTStartup(void *module, unsigned reason, void *reserved)
{
    (void)module, (void)reason, (void)reserved;
    return 1;
}
