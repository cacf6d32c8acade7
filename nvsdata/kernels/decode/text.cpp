// Lines of decimal numbers to event columns.
#include <tuple>

#include "../native/bind.h"
#include "../native/require.h"
#include "../native/times.h"
#include "columns.h"

namespace nvsdata {

namespace {

enum Fault { OK, BAD_NUMBER, BAD_COUNT, OUT_OF_RANGE, TOO_LATE };

constexpr i64 MOST = INT64_MAX;
constexpr int DECIMALS = 6;  // of seconds

bool is_digit(u8 c) { return c >= '0' && c <= '9'; }
bool is_space(u8 c) { return c == ' ' || c == '\t' || c == ',' || c == ';' || c == '\r'; }

// Reads numbers of a text from byte `i` on.
struct Reader {
    Span<const u8> raw;
    i64 i = 0;
    i64 values[4] = {};

    bool more() const { return i < raw.size(); }
    u8 here() const { return raw[i]; }

    // Read the numbers of a line, one of them in seconds unless `seconds_at` is -1: their number, the fault and its byte
    // `where`. Continues at the next line.
    std::pair<int, Fault> line(i64 seconds_at, i64& where) {
        int found = 0;
        Fault fault = OK;
        where = i;
        bool comment = here() == '#' || here() == '%';
        while (more() && here() != '\n') {
            if (comment || fault != OK || is_space(here())) {
                ++i;
            } else if (found == 4) {
                fault = BAD_COUNT;
            } else if (number(found == seconds_at, values[found])) {
                ++found;
            } else {
                fault = BAD_NUMBER;
                where = i;
            }
        }
        ++i;
        if (fault == OK && 0 < found && found < 4) fault = BAD_COUNT;
        return {found, fault};
    }

    // Read one decimal number. Continues at the byte after it, or at the byte that makes it invalid. With `seconds`, a
    // fraction is allowed and the value is in µs. Without, a number may end in `.0`. Numbers beyond i64 are refused.
    bool number(bool seconds, i64& value) {
        bool negative = here() == '-';
        if (negative) ++i;
        i64 digits = 0, sum = 0;
        for (; more() && is_digit(here()); ++i) {
            if (++digits > 18 && sum > (MOST - 9) / 10) return false;
            sum = sum * 10 + (here() - '0');
        }
        if (digits == 0) return false;
        int decimals = seconds ? DECIMALS : 0;
        if (seconds && sum > MOST / 1'000'000 - 1) return false;
        if (more() && here() == '.') {
            for (++i; more() && is_digit(here()); ++i)
                if (decimals > 0) {
                    sum = sum * 10 + (here() - '0');
                    --decimals;
                } else if (!seconds && here() != '0') {
                    return false;
                }
        }
        for (; decimals > 0; --decimals) sum *= 10;
        if (more() && !is_space(here()) && here() != '\n') return false;
        value = negative ? -sum : sum;
        return true;
    }
};

}  // namespace

std::tuple<i64, int, i64, i64> text_decode(Span<const u8> raw, i64 t_at, i64 x_at, i64 y_at, i64 p_at, bool seconds,
                                           bool skip_faults, Span<i64> t, Span<i16> x, Span<i16> y, Span<u8> p) {
    for (i64 at : {t_at, x_at, y_at, p_at}) require(at >= 0 && at < 4, "a line has four numbers");
    i64 room = t.size(), kept = 0, dropped = 0, where = 0;
    Columns out{t, x, y, p, 0, room};
    Reader reader{raw};
    while (reader.more()) {
        auto [found, fault] = reader.line(seconds ? t_at : -1, where);
        if (found == 0 && fault == OK) continue;
        const i64* values = reader.values;
        i64 time = values[t_at], column = values[x_at], row = values[y_at], polarity = values[p_at];
        bool inside = column >= 0 && row >= 0 && column <= 32766 && row <= 32766 && polarity >= -1 && polarity <= 1;
        if (fault == OK && !inside) fault = OUT_OF_RANGE;
        if (fault == OK && (time <= -LATEST || time >= LATEST)) fault = TOO_LATE;
        if (fault != OK) {
            if (!skip_faults) return {kept, fault, where, dropped};
            ++dropped;
            continue;
        }
        require(kept < room, "columns are too short for the lines");
        out.t[kept] = time;
        out.x[kept] = i16(column);
        out.y[kept] = i16(row);
        out.p[kept++] = polarity > 0;
    }
    return {kept, OK, 0, dropped};
}

void define_text(nb::module_& module) { define<text_decode>(module, "text_decode"); }

}  // namespace nvsdata
