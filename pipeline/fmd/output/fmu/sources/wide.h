/* Functions that are compiled twice on x86-64: for every processor, and for those with vectors of four numbers. */
#ifndef WIDE_H
#define WIDE_H

#if defined(__x86_64__) && (defined(__GNUC__) || defined(__clang__))
#define HAS_WIDE 1
#define WIDE __attribute__((target("avx2,fma")))
#else
#define HAS_WIDE 0
#endif

/* 1 if this processor and its system have such vectors. */
int has_wide_vectors(void);

#endif
