// Helpers of loops over events: checked places in images, and polls for Ctrl-C.
#pragma once

#include <algorithm>
#include <stdexcept>

#include "../native/interrupt.h"
#include "../native/levels.h"
#include "../native/require.h"
#include "../native/span.h"
#include "../native/wrap.h"

namespace nvsdata {

inline void require_shapes(bool fit) { require(fit, "the arrays' shapes don't belong together"); }

// Images with a margin around the sensor.
inline void require_margin(i64 margin, i64 rows, i64 columns) {
    require_shapes(margin >= 0 && margin <= std::min(rows, columns) / 2);
}

// Images of all pixels, row by row, one after the other; rows and images may be larger than the sensor.
struct Images {
    i64 width, height;
    i64 stride = width, size = width * height;  // from one row to the next, from one image to the next
};

enum class Polarity { same_image, off_first, on_first };

// Pixels of events and, if a kernel needs them, polarities, which may select one of two images.
struct Pixels {
    Span<const i16> x, y;
    Span<const u8> p = {};
    Polarity image = Polarity::same_image;
};

constexpr i64 STEPS = 512;       // events that are placed at once; with more, an image takes 10% longer
constexpr i64 OFTEN = 1 << 14;  // events between two polls for Ctrl-C, a multiple of STEPS

// Places of the pixels of at most STEPS events in images. The calls return true if all are on the sensor.
bool place(const Images& images, const Pixels& events, i64 from, i64 to, u32* places);
bool are_inside(const Images& images, const Pixels& events);

// Times since the first one, multiplied by scale / span. Returns whether all are from 0 to `most` before scaling.
bool scale_times(const i64* t, i64 count, i64 first, u64 most, double scale, double span, double* out);

inline void require_inside(bool inside) {
    if (!inside) throw std::out_of_range("events lie outside of the sensor, or have polarities other than 0 and 1");
}

inline void place_all(const Images& images, const Pixels& events, i64 from, i64 to, u32* places) {
    require_inside(place(images, events, from, to, places));
}

// The loops below are always inlined, so that the variables of a kernel stay in registers.

// Calls some(from, count, places) for every STEPS of the events; throws before any that isn't on the sensor.
template <class Some>
NVSDATA_INLINE void some_events(const Images& images, const Pixels& events, i64 from, i64 to,
                         Interrupt& interrupt, Some some) {
    u32 places[STEPS];
    for (i64 done = STEPS; from < to; done += STEPS) {
        i64 count = std::min(STEPS, to - from);
        place_all(images, events, from, from + count, places);
        some(from, count, places);
        from += count;
        if (done % OFTEN == 0) interrupt.poll();
    }
}

// Calls each(i, place) for the events i from `from` up to `to`.
template <class Each>
NVSDATA_INLINE void each_event(const Images& images, const Pixels& events, i64 from, i64 to,
                        Interrupt& interrupt, Each each) {
    some_events(images, events, from, to, interrupt, [&](i64 begin, i64 count, const u32* places) {
        for (i64 k = 0; k < count; ++k) each(begin + k, i64(places[k]));
    });
}

inline void require_columns(i64 size, const Pixels& events) {
    require(events.x.size() == size && events.y.size() == size && (events.p.size() == size || !events.p.data()),
            "columns of events must be equally long");
}

template <class Each>
NVSDATA_INLINE void each_event(const Images& images, const Pixels& events, Each each) {
    require_columns(events.x.size(), events);
    Interrupt interrupt;
    each_event(images, events, 0, events.x.size(), interrupt, each);
}

inline void check_frame(Span<const i64> bounds, i64 n, i64 size) {
    if (bounds[n] < 0 || bounds[n + 1] > size) throw std::out_of_range("frames reach beyond the events");
}

// Calls frame(n) for each frame n, and what it returns, each(i, place), for the events i from bounds[n] up to
// bounds[n + 1]; then done(n).
template <class Frame, class Done>
NVSDATA_INLINE void each_event_of_frames(const Images& images, const Pixels& events, Span<const i64> bounds, i64 frames,
                                  Frame frame, Done done) {
    require_columns(events.x.size(), events);
    require(bounds.size() == frames + 1, "frames must be one fewer than their bounds");
    Interrupt interrupt;
    for (i64 n = 0; n < frames; ++n) {
        check_frame(bounds, n, events.x.size());
        each_event(images, events, bounds[n], bounds[n + 1], interrupt, frame(n));
        done(n);
        if (n % STEPS == 0) interrupt.poll();
    }
}

template <class Frame>
NVSDATA_INLINE void each_event_of_frames(const Images& images, const Pixels& events, Span<const i64> bounds, i64 frames,
                                  Frame frame) {
    each_event_of_frames(images, events, bounds, frames, frame, [](i64) {});
}

}  // namespace nvsdata
