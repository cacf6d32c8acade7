// Arrays that are zero at first, and whose memory is allocated when it is first written.
#pragma once

#include <algorithm>
#include <cstdlib>
#include <new>
#include <utility>
#include <vector>

#include "../native/vector.h"

namespace nvsdata::streaming {

template <class T>
struct Zeros {
    using value_type = T;
    Zeros() = default;
    template <class U>
    Zeros(const Zeros<U>&) {}

    T* allocate(std::size_t n) {
        void* memory = std::calloc(n, sizeof(T));
        if (!memory) throw std::bad_alloc();
        return static_cast<T*>(memory);
    }
    void deallocate(T* memory, std::size_t) { std::free(memory); }
    template <class U>
    void construct(U*) {}
    template <class U, class... A>
    void construct(U* place, A&&... values) {
        ::new (static_cast<void*>(place)) U(std::forward<A>(values)...);
    }
    friend bool operator==(const Zeros&, const Zeros&) { return true; }
    friend bool operator!=(const Zeros&, const Zeros&) { return false; }
};

template <class T>
class Column : public Vector<T, Zeros<T>> {
public:
    explicit Column(i64 size = 0) : Vector<T, Zeros<T>>(std::size_t(size)) {}
    i64 size() const { return i64(Vector<T, Zeros<T>>::size()); }
    void fill(T value) { std::fill(this->begin(), this->end(), value); }
};

template <class T>
class Table {
public:
    explicit Table(i64 rows = 0, i64 columns = 0)
        : rows_(rows), columns_(columns), values_(std::size_t(rows * columns)) {}
    explicit Table(Rows<const T> values) : Table(values.rows(), values.columns()) {
        std::copy(values.flat().begin(), values.flat().end(), values_.begin());
    }
    Span<T> operator[](i64 row) { return Rows<T>(values_.data(), rows_, columns_)[row]; }
    Span<const T> operator[](i64 row) const { return Rows<const T>(values_.data(), rows_, columns_)[row]; }
    T& operator()(i64 row, i64 column) { return Rows<T>(values_.data(), rows_, columns_)(row, column); }
    const T& operator()(i64 row, i64 column) const {
        return Rows<const T>(values_.data(), rows_, columns_)(row, column);
    }
    i64 rows() const { return rows_; }
    i64 columns() const { return columns_; }

private:
    i64 rows_, columns_;
    std::vector<T, Zeros<T>> values_;
};

// Rows of events: the row of an event is its number modulo the capacity, which is a power of two. `widen` grows the
// arrays for events from `first` up to `next`.
template <class T>
void widen(Column<T>& column, i64 capacity, i64 first, i64 next) {
    Column<T> wide(capacity);
    for (i64 number = first; number < next; ++number)
        wide[number & (capacity - 1)] = column[number & (column.size() - 1)];
    column = std::move(wide);
}

template <class T>
void widen(Table<T>& table, i64 capacity, i64 first, i64 next) {
    Table<T> wide(capacity, table.columns());
    for (i64 number = first; number < next; ++number) {
        auto row = table[number & (table.rows() - 1)];
        std::copy(row.begin(), row.end(), wide[number & (capacity - 1)].begin());
    }
    table = std::move(wide);
}

// x, y and t of a node, or of a source as seen from a target.
struct Place {
    i64 x = 0, y = 0, t = 0;
    // sums of large times may have overflowed
    Place operator-(const Place& other) const { return {x - other.x, y - other.y, i64(u64(t) - u64(other.t))}; }
    bool operator==(const Place& other) const { return x == other.x && y == other.y && t == other.t; }
};

// A set of numbers in the order in which they were marked, each once.
class Marks {
public:
    explicit Marks(i64 size = 0) : marked_(size) {}
    bool has(i64 number) const { return marked_[number]; }
    void mark(i64 number) {
        if (marked_[number]) return;
        marked_[number] = 1;
        numbers_.push_back(number);
    }
    const std::vector<i64>& numbers() const { return numbers_; }
    void clear() {
        for (i64 number : numbers_) marked_[number] = 0;
        numbers_.clear();
    }
    // Move the numbers to keep into `kept`, and remove all.
    template <class Keep>
    void drain(std::vector<i64>& kept, Keep keep) {
        kept.clear();
        for (i64 number : numbers_)
            if (keep(number)) kept.push_back(number);
        clear();
    }

private:
    Column<u8> marked_;
    std::vector<i64> numbers_;
};

}  // namespace nvsdata::streaming
