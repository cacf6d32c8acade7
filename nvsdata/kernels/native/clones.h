// Loops that are compiled for several levels of x86-64 processors; the system's loader takes the highest that this one
// has. Results are the same: see the compiler's options in CMakeLists.txt.
#pragma once

#if defined(__x86_64__) && defined(__linux__) && defined(__GNUC__) && !defined(__clang__) && !defined(__SANITIZE_ADDRESS__)
#define NVSDATA_CLONES __attribute__((target_clones("default", "arch=x86-64-v3", "arch=x86-64-v4")))
#else
#define NVSDATA_CLONES
#endif
