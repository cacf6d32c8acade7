// Names in a packed store's index: bytes, each followed by a zero byte (docs/dev/store.md).
#include <algorithm>
#include <map>
#include <string_view>
#include <vector>

#include "../native/bind.h"
#include "../native/require.h"

namespace nvsdata {

namespace {

constexpr u32 FREE = 0;          // a slot without a name; the others have a name's number + 1
constexpr u64 MOST_STEPS = 512;  // from a hash to its slot; only names made to collide need as many

class Names {
public:
    // `ends` has the place of each name's zero byte.
    Names(Span<const u8> raw, Span<const u32> ends) : raw_(raw), ends_(ends) {
        i64 last = -1;
        bool rising = true;
        for (i64 n = 0; n < ends.size(); ++n) {
            rising &= i64(ends[n]) > last;
            last = ends[n];
        }
        require(rising && last < raw.size(), "names must end one after the other");
    }

    std::string_view operator[](i64 n) const { return at(raw_, ends_, n); }
    i64 size() const { return ends_.size(); }

    // Empty if there is no such name.
    static std::string_view at(Span<const u8> raw, Span<const u32> ends, i64 n) {
        if (n >= ends.size()) return {};
        i64 begin = n ? i64(ends[n - 1]) + 1 : 0, end = ends[n];
        if (begin > end || end > raw.size()) return {};
        return {reinterpret_cast<const char*>(raw.data()) + begin, std::size_t(end - begin)};
    }

private:
    Span<const u8> raw_;
    Span<const u32> ends_;
};

std::size_t folder_size(std::string_view name) {
    std::size_t slash = name.rfind('/');
    return slash == std::string_view::npos ? 0 : slash;
}

std::string_view file_of(std::string_view name) {
    std::size_t slash = name.rfind('/');
    return slash == std::string_view::npos ? name : name.substr(slash + 1);
}

std::size_t common(std::string_view a, std::string_view b) {
    std::size_t most = std::min(a.size(), b.size()), i = 0;
    while (i < most && a[i] == b[i]) ++i;
    return i;
}

struct Keyed {
    u64 key;
    u32 number;
};

// The first eight bytes, as a number with the same order; zeros where there are fewer.
u64 next_bytes(std::string_view name) {
    u64 key = 0;
    for (std::size_t i = 0; i < 8; ++i) key = key << 8 | (i < name.size() ? u8(name[i]) : u8(0));
    return key;
}

// The slot of a name, or the free one in which it belongs: the first from its hash on; -1 if that is too far away.
template <class Is>
i64 slot_of(std::string_view name, Span<const u32> slots, Is is) {
    u64 mask = u64(slots.size()) - 1, first = std::hash<std::string_view>()(name);
    for (u64 step = 0; step < MOST_STEPS; ++step) {
        i64 slot = i64((first + step) & mask);
        if (slots[slot] == FREE || is(i64(slots[slot]) - 1)) return slot;
    }
    return -1;
}

void require_table(Span<const u32> slots, i64 names) {
    i64 size = slots.size();
    require(size > names && (size & (size - 1)) == 0, "slots must be a power of two above the number of names");
}

}  // namespace

// Fills `slots` with a hash table of the names. Returns whether all names differ.
bool enter_names(Span<const u8> raw, Span<const u32> ends, Span<u32> slots) {
    Names names(raw, ends);
    require_table(slots, names.size());
    std::fill(slots.begin(), slots.end(), FREE);
    for (i64 n = 0; n < names.size(); ++n) {
        std::string_view name = names[n];
        i64 slot = slot_of(name, slots, [&](i64 other) { return names[other] == name; });
        if (slot < 0 || slots[slot] != FREE) return false;
        slots[slot] = u32(n) + 1;
    }
    return true;
}

// The number of a name that `enter_names` entered, or -1.
i64 find_name(Span<const u8> raw, Span<const u32> ends, Span<const u32> slots, Span<const u8> name) {
    require_table(slots, ends.size());
    // not `Names`, which looks at all ends
    std::string_view wanted(reinterpret_cast<const char*>(name.data()), std::size_t(name.size()));
    i64 slot = slot_of(wanted, slots, [&](i64 n) { return Names::at(raw, ends, n) == wanted; });
    return slot < 0 ? -1 : i64(slots[slot]) - 1;
}

// Fills `folders` with the number of each name's folder, from 0 on in the order of their first names; returns how many.
i64 folders_of_names(Span<const u8> raw, Span<const u32> ends, Span<u32> folders) {
    Names names(raw, ends);
    require(folders.size() == names.size(), "there must be a folder for each name");
    // no hash table, because names of a file from elsewhere may collide on purpose
    std::map<std::string_view, u32> known;
    std::string_view last;
    for (i64 n = 0; n < names.size(); ++n) {
        std::string_view folder = names[n].substr(0, folder_size(names[n]));
        bool same = n && folder == last;
        folders[n] = same ? folders[n - 1] : known.try_emplace(folder, u32(known.size())).first->second;
        last = folder;
    }
    return i64(known.size());
}

// Sorts numbers of names: by file and then by folder or, unless `by_file`, by the whole name.
void sort_names(Span<const u8> raw, Span<const u32> ends, bool by_file, Span<u32> numbers) {
    Names names(raw, ends);
    bool there = true;
    for (i64 i = 0; i < numbers.size(); ++i) there &= i64(numbers[i]) < names.size();
    require(there, "numbers must be those of names");
    auto first = [&](u32 n) { return by_file ? file_of(names[n]) : names[n]; };
    auto before = [&](u32 a, u32 b) {
        int sign = first(a).compare(first(b));
        return sign ? sign < 0 : names[a] < names[b];
    };
    // a store usually has them in order
    if (std::is_sorted(numbers.begin(), numbers.end(), before)) return;
    std::size_t shared = first(numbers[0]).size();
    for (u32 n : numbers) shared = std::min(shared, common(first(numbers[0]), first(n)));
    // most comparisons need only the bytes after the shared ones, which are at hand
    std::vector<Keyed> keyed;
    keyed.reserve(std::size_t(numbers.size()));
    for (u32 n : numbers) keyed.push_back({next_bytes(first(n).substr(shared)), n});
    std::sort(keyed.begin(), keyed.end(), [&](const Keyed& a, const Keyed& b) {
        return a.key != b.key ? a.key < b.key : before(a.number, b.number);
    });
    for (i64 i = 0; i < numbers.size(); ++i) numbers[i] = keyed[std::size_t(i)].number;
}

void define_names(nb::module_& module) {
    define<enter_names>(module, "enter_names");
    define<find_name>(module, "find_name");
    define<folders_of_names>(module, "folders_of_names");
    define<sort_names>(module, "sort_names");
}

}  // namespace nvsdata
