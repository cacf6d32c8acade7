// CRC-32C (Castagnoli; RFC 3720, appendix B.4) of bytes.
#pragma once

#include <array>
#include <cstring>

#include "span.h"

#if defined(__SSE4_2__) && defined(__x86_64__)
#include <nmmintrin.h>
#define NVSDATA_CRC32C(crc, word) u32(_mm_crc32_u64(crc, word))
#elif defined(__ARM_FEATURE_CRC32)
#include <arm_acle.h>
#define NVSDATA_CRC32C(crc, word) __crc32cd(crc, word)
#endif

namespace nvsdata {

namespace crc {

constexpr u32 POLYNOMIAL = 0x82F63B78;  // reversed
constexpr i64 LANE = 1024;              // bytes of each of the three lanes that are computed side by side
using Table = std::array<std::array<u32, 256>, 8>;

// table[k][b]: the checksum of byte b, followed by k zeros.
constexpr Table byte_table() {
    Table table{};
    for (u32 b = 0; b < 256; ++b) {
        u32 value = b;
        for (int bit = 0; bit < 8; ++bit) value = (value >> 1) ^ (value & 1 ? POLYNOMIAL : 0);
        table[0][b] = value;
    }
    for (std::size_t k = 1; k < 8; ++k)
        for (std::size_t b = 0; b < 256; ++b) {
            u32 before = table[k - 1][b];
            table[k][b] = (before >> 8) ^ table[0][before & 255];
        }
    return table;
}

inline constexpr Table TABLE = byte_table();

inline u32 of_word(u32 crc, u64 word) {
#ifdef NVSDATA_CRC32C
    return NVSDATA_CRC32C(crc, word);
#else
    word ^= crc;
    u32 value = 0;
    for (std::size_t k = 0; k < 8; ++k) value ^= TABLE[7 - k][(word >> (8 * k)) & 255];
    return value;
#endif
}

inline u64 word_of(const u8* bytes) {
    u64 word;
    std::memcpy(&word, bytes, sizeof word);
    return word;
}

// shifted[k][b]: the checksum of byte k of a checksum, with value b, after LANE zeros.
inline const std::array<std::array<u32, 256>, 4>& lane_table() {
    static const auto table = [] {
        std::array<std::array<u32, 256>, 4> shifted{};
        for (u32 k = 0; k < 4; ++k)
            for (u32 b = 0; b < 256; ++b) {
                u32 value = b << (8 * k);
                for (i64 i = 0; i < LANE; i += 8) value = of_word(value, 0);
                shifted[k][b] = value;
            }
        return shifted;
    }();
    return table;
}

inline u32 after_lane(u32 crc) {
    const auto& table = lane_table();
    return table[0][crc & 255] ^ table[1][(crc >> 8) & 255] ^ table[2][(crc >> 16) & 255] ^ table[3][crc >> 24];
}

}  // namespace crc

inline u32 crc32c(Span<const u8> bytes) {
    count_touched(bytes.size());
    const u8* at = bytes.data();
    i64 left = bytes.size();
    u32 value = ~u32(0);
    // an instruction depends on the one before; three independent ones run in the time of one
    for (; left >= 3 * crc::LANE; left -= 3 * crc::LANE, at += 3 * crc::LANE) {
        u32 second = 0, third = 0;
        for (i64 i = 0; i < crc::LANE; i += 8) {
            value = crc::of_word(value, crc::word_of(at + i));
            second = crc::of_word(second, crc::word_of(at + crc::LANE + i));
            third = crc::of_word(third, crc::word_of(at + 2 * crc::LANE + i));
        }
        value = crc::after_lane(crc::after_lane(value) ^ second) ^ third;
    }
    for (; left >= 8; left -= 8, at += 8) value = crc::of_word(value, crc::word_of(at));
    for (; left > 0; --left, ++at) value = (value >> 8) ^ crc::TABLE[0][(value ^ *at) & 255];
    return ~value;
}

}  // namespace nvsdata
