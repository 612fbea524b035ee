// Broken invariants of our own state: always armed, aborts, the service manager restarts.
#pragma once

#include <cstdio>
#include <cstdlib>

#define TERES_CHECK(condition)                                                                              \
    do {                                                                                                    \
        if (!(condition)) {                                                                                 \
            std::fprintf(stderr, "teres: broken invariant at %s:%d: %s\n", __FILE__, __LINE__, #condition); \
            std::abort();                                                                                   \
        }                                                                                                   \
    } while (false)
