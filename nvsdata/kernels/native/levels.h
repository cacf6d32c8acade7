// Loops compiled for several instruction sets of x86-64, of which the processor's best one runs.
//
// `best<body>(arguments...)` calls `body`, an NVSDATA_INLINE function. The environment variable
// NVSDATA_CPU (v2, v3, v4) sets the highest level; v2 is the code that every function has, and all that other compilers
// and processors get. Results are the same at all levels: no level contracts products and sums (-ffp-contract=off).
#pragma once

#include <algorithm>
#include <cstdlib>
#include <cstring>
#include <stdexcept>
#include <string>

#if defined(__x86_64__) && defined(__GNUC__)
#define NVSDATA_LEVELS
#endif

#ifdef __GNUC__
#define NVSDATA_INLINE inline __attribute__((always_inline))
#else
#define NVSDATA_INLINE inline
#endif

namespace nvsdata {

// The same bits as another type.
template <class To, class From>
NVSDATA_INLINE To bits_of(From value) {
    To bits;
    std::memcpy(&bits, &value, sizeof(To));
    return bits;
}

// The highest level that the processor has: 2, 3 or 4.
inline int processor_level() {
#ifdef NVSDATA_LEVELS
    // exactly what the functions below are compiled for
    if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("bmi") && __builtin_cpu_supports("bmi2")) {
        bool wide = __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512bw") &&
                    __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512vl");
        return wide ? 4 : 3;
    }
#endif
    return 2;
}

inline int allowed_level() {
    const char* given = std::getenv("NVSDATA_CPU");
    std::string name = given ? given : "";
    if (name.empty()) return 4;
    if (name != "v2" && name != "v3" && name != "v4")
        throw std::invalid_argument("NVSDATA_CPU is \"" + name + "\": it must be v2, v3 or v4");
    return name[1] - '0';
}

// The level of this process; the environment variable is read at the first call.
inline int level() {
    static const int chosen = std::min(allowed_level(), processor_level());
    return chosen;
}

template <auto body>
struct Levels;

template <class R, class... A, R (*body)(A...)>
struct Levels<body> {
    static R v2(A... given) { return body(given...); }
#ifdef NVSDATA_LEVELS
    __attribute__((target("avx2,bmi,bmi2"))) static R v3(A... given) { return body(given...); }
    __attribute__((target("avx2,bmi,bmi2,avx512f,avx512bw,avx512dq,avx512vl"))) static R v4(A... given) {
        return body(given...);
    }
#endif
};

template <auto body, class... A>
auto best(A... given) {
#ifdef NVSDATA_LEVELS
    int which = level();
    if (which == 4) return Levels<body>::v4(given...);
    if (which == 3) return Levels<body>::v3(given...);
#endif
    return Levels<body>::v2(given...);
}

}  // namespace nvsdata
