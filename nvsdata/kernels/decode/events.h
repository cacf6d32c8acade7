// Events that are copied from columns to columns.
#pragma once

#include "../native/require.h"
#include "columns.h"

namespace nvsdata {

struct Events {
    Span<const i64> t;
    Span<const i16> x, y;
    Span<const u8> p;

    Events(Span<const i64> t, Span<const i16> x, Span<const i16> y, Span<const u8> p) : t(t), x(x), y(y), p(p) {
        require(x.size() == t.size() && y.size() == t.size() && p.size() == t.size(), "columns must be equally long");
    }
    i64 size() const { return t.size(); }
    void copy(i64 i, const Columns& to, i64 place) const {
        to.t[place] = t[i];
        to.x[place] = x[i];
        to.y[place] = y[i];
        to.p[place] = p[i];
    }
};

}  // namespace nvsdata
