// Loops compiled for several instruction sets of x86-64, of which the processor's best one runs.
//
// `best<body>(arguments...)` calls `body`, an NVSDATA_INLINE function. The environment variable NVSDATA_CPU (v2, v3,
// v4) sets the highest level. Every function has code for v2, which is the only level for other compilers and
// processors. Results are the same at all levels, because products and sums aren't fused (-ffp-contract=off).
#pragma once

#include <algorithm>
#include <cstdlib>
#include <cstring>
#include <stdexcept>
#include <string>

#if defined(__x86_64__) && defined(__GNUC__)
#define NVSDATA_LEVELS
#include <cpuid.h>
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

#ifdef NVSDATA_LEVELS
// The registers that the system keeps for each thread: a bit for each kind.
inline unsigned kept_registers() {
    unsigned low, high;
    __asm__("xgetbv" : "=a"(low), "=d"(high) : "c"(0));
    return low;
}
#endif

// The highest level that the processor has: 2, 3 or 4.
inline int processor_level() {
#ifdef NVSDATA_LEVELS
    // not __builtin_cpu_supports, which is always 0 with ziglang 0.17
    unsigned a, b, c, d;
    if (!__get_cpuid(1, &a, &b, &c, &d) || !(c & bit_OSXSAVE)) return 2;
    if (!__get_cpuid_count(7, 0, &a, &b, &c, &d)) return 2;
    // exactly the features for which the functions below are compiled, and their registers of 256 and 512 bits
    constexpr unsigned three = bit_AVX2 | bit_BMI | bit_BMI2;
    constexpr unsigned four = bit_AVX512F | bit_AVX512BW | bit_AVX512DQ | bit_AVX512VL;
    if ((b & three) != three || (kept_registers() & 0x06) != 0x06) return 2;
    return (b & four) == four && (kept_registers() & 0xE6) == 0xE6 ? 4 : 3;
#else
    return 2;
#endif
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
