// The tiles of a frame: tiles that don't change are skipped.
#pragma once

#include <algorithm>

#include "../native/span.h"

namespace nvsdata {

constexpr i64 TILE_ROWS = 8, TILE_COLUMNS = 64;  // 64 pixels of 3 bytes are three cache lines

inline i64 tiles_along(i64 pixels, i64 side) { return (pixels + side - 1) / side; }

// Rows top to bottom - 1 and columns left to right - 1.
struct Box {
    i64 top, bottom, left, right;
};

inline Box tile_box(i64 r, i64 c, i64 height, i64 width) {
    return {r * TILE_ROWS, std::min((r + 1) * TILE_ROWS, height), c * TILE_COLUMNS,
            std::min((c + 1) * TILE_COLUMNS, width)};
}

// Call each(left, right), columns of pixels, for the runs of marked tiles in a row of tiles.
template <class Each>
void each_run(Span<const bool> marks, i64 width, Each each) {
    for (i64 c = 0; c < marks.size(); ++c) {
        if (!marks[c]) continue;
        i64 first = c;
        while (c + 1 < marks.size() && marks[c + 1]) ++c;
        each(first * TILE_COLUMNS, std::min((c + 1) * TILE_COLUMNS, width));
    }
}

// Call each(box of pixels) for the runs of marked tiles.
template <class Each>
void each_box(Rows<const bool> marks, i64 height, i64 width, Each each) {
    for (i64 r = 0; r < marks.rows(); ++r)
        each_run(marks[r], width, [&](i64 left, i64 right) {
            each(Box{r * TILE_ROWS, std::min((r + 1) * TILE_ROWS, height), left, right});
        });
}

// Call each(row of tiles, column of tiles, box of pixels) for marked tiles.
template <class Each>
void each_tile(Rows<const bool> marks, i64 height, i64 width, Each each) {
    for (i64 r = 0; r < marks.rows(); ++r)
        for (i64 c = 0; c < marks.columns(); ++c)
            if (marks(r, c)) each(r, c, tile_box(r, c, height, width));
}

// Rows from `top` to `end` - 1.
template <class T>
Rows<T> band(Rows<T> rows, i64 top, i64 end) {
    check_index(u64(end), u64(rows.rows()) + 1);
    return {rows.data() + top * rows.columns(), end - top, rows.columns()};
}

// Throws std::invalid_argument (ValueError in Python) unless arrays have one value per tile, or per pixel.
void check_tiles(Rows<const bool> marks, i64 height, i64 width);
void check_pixels(i64 rows, i64 columns, i64 height, i64 width);
// Throws the same unless both frames have the same whole number of bytes per pixel; returns the bytes of a pixel.
i64 check_frames(Rows<const u8> frame, Rows<const u8> previous, i64 height, i64 width);

// Mark the tiles that differ from the `previous` frame; tiles are `tile_bytes` bytes wide. Returns their number.
// O(bytes).
i64 find_dirty(Rows<const u8> frame, Rows<const u8> previous, i64 tile_bytes, Rows<bool> dirty);

// Whether each tile or any of its eight neighbors is marked; `out` may be the same.
void spread(Rows<const bool> marks, Rows<bool> out);

}  // namespace nvsdata
