// The tiles of a frame that changed.
#include "tiles.h"

#include <vector>

#include "../native/bind.h"
#include "../native/require.h"

namespace nvsdata {

namespace {

bool same(Span<const u8> a, Span<const u8> b) {
    count_touched(a.size());
    return std::equal(a.begin(), a.end(), b.begin(), b.end());
}

}  // namespace

void check_pixels(i64 rows, i64 columns, i64 height, i64 width) {
    require(rows == height && columns == width, "arrays of pixels differ in shape");
}

void check_tiles(Rows<const bool> marks, i64 height, i64 width) {
    require(marks.rows() == tiles_along(height, TILE_ROWS) && marks.columns() == tiles_along(width, TILE_COLUMNS),
            "arrays of tiles don't fit those of pixels");
}

i64 check_frames(Rows<const u8> frame, Rows<const u8> previous, i64 height, i64 width) {
    i64 bytes = width ? frame.columns() / width : 0;
    require(frame.rows() == height && frame.columns() == bytes * width && previous.rows() == height &&
                previous.columns() == frame.columns(),
            "frames don't fit arrays of pixels");
    return bytes;
}

i64 find_dirty(Rows<const u8> frame, Rows<const u8> previous, i64 tile_bytes, Rows<bool> dirty) {
    require(previous.rows() == frame.rows() && previous.columns() == frame.columns(), "frames differ in shape");
    // so that every byte is in a tile
    require(tile_bytes >= 1 && dirty.rows() == tiles_along(frame.rows(), TILE_ROWS) &&
                dirty.columns() == tiles_along(frame.columns(), tile_bytes),
            "arrays of tiles don't fit frames");
    i64 count = 0;
    for (i64 r = 0; r < dirty.rows(); ++r) {
        Span<bool> marks = dirty[r];
        std::fill(marks.begin(), marks.end(), false);
        i64 marked = 0;
        for (i64 y = r * TILE_ROWS; y < std::min((r + 1) * TILE_ROWS, frame.rows()) && marked < marks.size(); ++y) {
            // whole rows while all tiles are clean: memory is read fastest sequentially
            if (marked == 0 && same(frame[y], previous[y])) continue;
            for (i64 c = 0; c < marks.size(); ++c) {
                if (marks[c]) continue;
                i64 from = c * tile_bytes, to = std::min(from + tile_bytes, frame.columns());
                marks[c] = !same(frame[y].part(from, to), previous[y].part(from, to));
                marked += marks[c];
            }
        }
        count += marked;
    }
    return count;
}

void spread(Rows<const bool> marks, Rows<bool> out) {
    i64 rows = marks.rows(), columns = marks.columns();
    std::vector<u8> given(marks.flat().begin(), marks.flat().end());
    for (i64 r = 0; r < rows; ++r)
        for (i64 c = 0; c < columns; ++c) {
            u8 found = 0;
            for (i64 i = std::max<i64>(r - 1, 0); i < std::min(r + 2, rows); ++i)
                for (i64 j = std::max<i64>(c - 1, 0); j < std::min(c + 2, columns); ++j)
                    found |= given[i * columns + j];
            out(r, c) = found;
        }
}

void define_tiles(nb::module_& module) { define<find_dirty>(module, "find_dirty"); }

}  // namespace nvsdata
