// Functions that are compiled for several processors: the best one is chosen when the module is loaded.
//
// Results don't depend on the choice: products and sums are never contracted (see CMakeLists.txt).
#pragma once

#if defined(__x86_64__) && defined(__linux__) && defined(__GNUC__) && !defined(__clang__) && __GNUC__ >= 12 && \
    !defined(__SANITIZE_ADDRESS__)
#define NVSDATA_CLONES __attribute__((target_clones("arch=x86-64-v4", "arch=x86-64-v3", "default")))
#else
#define NVSDATA_CLONES
#endif
