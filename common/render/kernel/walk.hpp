// What wide rays meet first: from crossing to crossing, until what fills the space changes.
#pragma once

#include "common/render/kernel/roots.hpp"
#include "common/render/kernel/tables.hpp"
#include "common/render/kernel/wide.hpp"

#include <vector>

namespace fraja::kernel {
namespace {

/// What fills the space where leaves overlap and neither displaces all others.
constexpr std::int32_t unresolved = -2;

/// Calls f(surface, index) for every surface, with its own type.
template <class F>
FRAJA_WIDE void for_each_surface(const Tables& tables, F&& f) {
    std::int64_t index = 0;
    for (std::uint32_t i = 0; i < tables.sphere_count; ++i)
        f(tables.spheres[i], index++);
    for (std::uint32_t i = 0; i < tables.plane_count; ++i)
        f(tables.planes[i], index++);
    for (std::uint32_t i = 0; i < tables.cylinder_count; ++i)
        f(tables.cylinders[i], index++);
    for (std::uint32_t i = 0; i < tables.cone_count; ++i)
        f(tables.cones[i], index++);
}

/// Calls f(surface) for the one with that index.
template <class F>
FRAJA_WIDE auto with_surface(const Tables& tables, std::uint32_t index, F&& f) {
    if (index < tables.sphere_count)
        return f(tables.spheres[index]);
    index -= tables.sphere_count;
    if (index < tables.plane_count)
        return f(tables.planes[index]);
    index -= tables.plane_count;
    if (index < tables.cylinder_count)
        return f(tables.cylinders[index]);
    return f(tables.cones[index - tables.cylinder_count]);
}

/// Bit `index` of each lane's words.
FRAJA_WIDE Mask bit_at(const WideInt* words, std::int64_t index) {
    return (words[index >> 6] & all_lanes(std::int64_t{1} << (index & 63))) != 0;
}

/// One lane's set of leaves (or surfaces), as words.
class LaneSet {
public:
    LaneSet(const WideInt* words, std::uint32_t word_count, int lane)
        : words_(words), word_count_(word_count), lane_(lane) {}
    [[nodiscard]] std::uint32_t word_count() const { return word_count_; }
    [[nodiscard]] std::uint64_t word(std::uint32_t w) const {
        return static_cast<std::uint64_t>(words_[w][lane_]);
    }

private:
    const WideInt* words_;
    std::uint32_t word_count_;
    int lane_;
};

/// Calls f(index) for each bit that word_of(w) has, lowest first, until it answers false.
template <class WordOf, class F>
inline void for_each_bit(std::uint32_t word_count, WordOf&& word_of, F&& f) {
    for (std::uint32_t w = 0; w < word_count; ++w)
        for (std::uint64_t rest = word_of(w); rest != 0; rest &= rest - 1)
            if (!f(static_cast<std::int32_t>(64 * w) + __builtin_ctzll(rest)))
                return;
}

/// The leaf of a set that displaces all others: what fills the space. none of an empty set.
template <class WordOf>
inline std::int32_t filler_of(const Tables& tables, WordOf&& word_of) {
    const std::uint32_t words = tables.leaf_words;
    bool is_empty = true;
    std::int32_t filler = unresolved;
    for_each_bit(words, word_of, [&](std::int32_t candidate) {
        is_empty = false;
        const std::uint64_t* displaced =
            tables.displaced_by + static_cast<std::size_t>(candidate) * words;
        for (std::uint32_t w = 0; w < words; ++w) {
            std::uint64_t others = word_of(w);
            if (w == static_cast<std::uint32_t>(candidate) >> 6)
                others &= ~(std::uint64_t{1} << (candidate & 63));
            if (others & ~displaced[w])
                return true; // not this one
        }
        filler = candidate;
        return false;
    });
    return is_empty ? none : filler;
}

/// Two leaves of a set without a filler, neither of which displaces the other; if there are no such
/// two, some.
template <class WordOf>
inline void overlapping_pair(const Tables& tables, WordOf&& word_of, std::uint32_t (&pair)[2]) {
    const std::uint32_t words = tables.leaf_words;
    const auto displaces = [&](std::int32_t a, std::int32_t b) {
        return (tables.displaced_by[static_cast<std::size_t>(a) * words +
                                    (static_cast<std::uint32_t>(b) >> 6)] >>
                    (b & 63) &
                1) != 0;
    };
    bool found = false;
    std::int32_t first = none;
    for_each_bit(words, word_of, [&](std::int32_t a) {
        for_each_bit(words, word_of, [&](std::int32_t b) {
            if (a == b)
                return true;
            if (first == none || (!displaces(a, b) && !displaces(b, a))) {
                first = a;
                pair[0] = static_cast<std::uint32_t>(a), pair[1] = static_cast<std::uint32_t>(b);
                found = !displaces(a, b) && !displaces(b, a);
            }
            return !found;
        });
        return !found;
    });
}

/// What a ray that hit something needs to know of it.
struct Met {
    std::int32_t surface = none, leaf = none;
    std::int32_t beyond = none; ///< the leaf on the other side; none: the ambient volume
    bool leaving = false;       ///< the ray comes from within the leaf
};

/// Follows wide rays through a scene whose rays carry state. One thread's.
class Walker {
public:
    explicit Walker(const Tables& tables)
        : tables_(tables), first_(tables.surface_count), second_(tables.surface_count),
          bits_(tables.surface_words), before_(tables.leaf_words), after_(tables.leaf_words),
          met_after_(tables.leaf_words), filler_bit_(tables.leaf_words), shows_(tables.leaf_words),
          stack_(tables.stack_max + 1) {}

    /// The bits of the surfaces that the next walk's rays start inside of, by word. A walk leaves
    /// those that hold just before the hit.
    [[nodiscard]] WideInt* inside() { return bits_.data(); }

    struct Visible {
        Mask hit;
        Wide t;
        WideInt surface;
    };
    /// The first crossing nearer than `limit` at which what fills the space changes. Only of
    /// `active` lanes.
    Visible walk(const WideRays& rays, Mask active, Wide limit);
    /// Of a lane that the last walk hit.
    [[nodiscard]] Met met(const Visible& visible, int lane);

    /// Whether a ray needed a priority that the scene does not give.
    [[nodiscard]] bool failed() const { return failed_; }
    [[nodiscard]] const std::uint32_t (&overlapping() const)[2] { return overlapping_; }

    /// Fills inside() for rays that start anywhere.
    void find_inside(Wide3 origin, Wide3 dir);

private:
    void leaves_at(const WideInt* bits, WideInt* leaves);
    Mask leaf_at(const WideInt* bits, const LeafTest& test);
    Mask run(const WideInt* bits, const LeafTest& test);
    void prepare_fillers();
    template <class WordOf>
    std::int32_t resolved(std::int32_t filler, WordOf&& word_of);

    const Tables& tables_;
    std::vector<Wide> first_, second_; ///< the next crossing with each surface, and the one after
    std::vector<WideInt> bits_;
    std::vector<WideInt> before_, after_;     ///< the leaves, on both sides of a crossing
    std::vector<WideInt> met_after_;          ///< beyond the visible crossing of a lane
    std::vector<WideInt> filler_bit_, shows_; ///< of each lane's filler: itself, what it lets show
    std::vector<Mask> stack_;
    std::int32_t filler_[lanes] = {};
    bool failed_ = false;
    std::uint32_t overlapping_[2] = {};
};

Mask Walker::run(const WideInt* bits, const LeafTest& test) {
    std::size_t top = 0;
    for (const Step* step = tables_.steps + test.begin;
         step != tables_.steps + test.begin + test.count; ++step) {
        switch (step->code) {
        case Step::Code::literal:
            stack_[top++] = bit_at(bits, step->operand);
            break;
        case Step::Code::negated_literal:
            stack_[top++] = ~bit_at(bits, step->operand);
            break;
        case Step::Code::all:
        case Step::Code::any: {
            const bool all = step->code == Step::Code::all;
            Mask joined = stack_[--top];
            for (std::uint32_t i = 1; i < step->operand; ++i) {
                --top;
                joined = all ? joined & stack_[top] : joined | stack_[top];
            }
            stack_[top++] = joined;
            break;
        }
        }
    }
    return stack_[0];
}

FRAJA_WIDE Mask Walker::leaf_at(const WideInt* bits, const LeafTest& test) {
    switch (test.kind) {
    case LeafTest::Kind::never:
        return Mask{};
    case LeafTest::Kind::always:
        return ~Mask{};
    case LeafTest::Kind::all:
    case LeafTest::Kind::any: {
        WideInt lacking{}, present{};
        for (const Term* term = tables_.terms + test.begin;
             term != tables_.terms + test.begin + test.count; ++term) {
            const WideInt mask = all_lanes(static_cast<std::int64_t>(term->mask));
            const WideInt true_ones =
                (bits[term->word] ^ all_lanes(static_cast<std::int64_t>(term->negated))) & mask;
            lacking |= true_ones ^ mask;
            present |= true_ones;
        }
        return test.kind == LeafTest::Kind::all ? lacking == 0 : present != 0;
    }
    case LeafTest::Kind::program:
        return run(bits, test);
    }
    return Mask{};
}

void Walker::leaves_at(const WideInt* bits, WideInt* leaves) {
    if (tables_.leaf_is_surface) {
        for (std::uint32_t w = 0; w < tables_.leaf_words; ++w)
            leaves[w] = bits[w];
        return;
    }
    for (std::uint32_t w = 0; w < tables_.leaf_words; ++w)
        leaves[w] = WideInt{};
    for (std::uint32_t i = 0; i < tables_.leaf_count; ++i)
        leaves[i >> 6] |= leaf_at(bits, tables_.leaves[i].test) &
                          all_lanes(static_cast<std::int64_t>(std::uint64_t{1} << (i & 63)));
}

void Walker::find_inside(Wide3 origin, Wide3 dir) {
    for (WideInt& word : bits_)
        word = WideInt{};
    for_each_surface(tables_, [&](const auto& surface, std::int64_t index) {
        bits_[static_cast<std::size_t>(index >> 6)] |=
            starts_inside(surface, origin, dir) & all_lanes(std::int64_t{1} << (index & 63));
    });
}

/// Of the lanes that start inside something: what fills the space there, and what shows in it.
void Walker::prepare_fillers() {
    const std::uint32_t words = tables_.leaf_words;
    for (std::uint32_t w = 0; w < words; ++w)
        filler_bit_[w] = shows_[w] = WideInt{};
    for (int lane = 0; lane < lanes; ++lane) {
        const LaneSet set(before_.data(), words, lane);
        filler_[lane] = filler_of(tables_, [&](std::uint32_t w) { return set.word(w); });
        if (filler_[lane] < 0)
            continue;
        const auto filler = static_cast<std::uint32_t>(filler_[lane]);
        filler_bit_[filler >> 6][lane] =
            static_cast<std::int64_t>(std::uint64_t{1} << (filler & 63));
        for (std::uint32_t w = 0; w < words; ++w)
            shows_[w][lane] =
                static_cast<std::int64_t>(tables_.shows_in[std::size_t{filler} * words + w]);
    }
}

Walker::Visible Walker::walk(const WideRays& rays, Mask active, Wide limit) {
    const std::uint32_t words = tables_.leaf_words;
    WideInt* const bits = bits_.data();
    for_each_surface(tables_, [&](const auto& surface, std::int64_t index) {
        const Crossings c = crossings_of(surface, index, rays, bit_at(bits, index));
        first_[static_cast<std::size_t>(index)] = c.first;
        second_[static_cast<std::size_t>(index)] = c.second;
    });
    leaves_at(bits, before_.data());
    Mask within{}; // the ray starts inside something
    for (std::uint32_t w = 0; w < words; ++w)
        within |= before_[w] != 0;
    within &= active;
    const bool any_within = any(within);
    if (any_within)
        prepare_fillers();

    Visible found{Mask{}, limit, all_lanes(std::int64_t{none})};
    Mask open = active;
    for (;;) {
        Wide t = limit;
        WideInt nearest = all_lanes(std::int64_t{none});
        for (std::uint32_t s = 0; s < tables_.surface_count; ++s) {
            const Mask closer = first_[s] < t;
            t = select(closer, first_[s], t);
            nearest = select(closer, all_lanes(std::int64_t{s}), nearest);
        }
        open &= nearest != all_lanes(std::int64_t{none});
        if (!any(open))
            return found;

        for (std::uint32_t w = 0; w < tables_.surface_words; ++w) {
            const Mask here = open & ((nearest >> 6) == all_lanes(std::int64_t{w}));
            bits[w] ^= here & (all_lanes(std::int64_t{1}) << (nearest & 63));
        }
        leaves_at(bits, after_.data());
        Mask changes{}, shows{};
        for (std::uint32_t w = 0; w < words; ++w) {
            const WideInt changed = before_[w] ^ after_[w];
            changes |= changed != 0;
            if (any_within)
                shows |= ((changed & before_[w] & filler_bit_[w]) |
                          (changed & after_[w] & shows_[w])) != 0;
        }
        const Mask visible = open & (within ? shows : changes);
        if (any_within)
            for (unsigned lanes_left = bits_of(open & within & changes); lanes_left != 0;
                 lanes_left &= lanes_left - 1) {
                const int lane = __builtin_ctz(lanes_left);
                if (filler_[lane] != unresolved)
                    continue;
                const LaneSet set(before_.data(), words, lane);
                resolved(unresolved, [&](std::uint32_t w) { return set.word(w); });
                return found;
            }
        found.hit |= visible;
        found.t = select(visible, t, found.t);
        found.surface = select(visible, nearest, found.surface);
        const Mask passed = open & ~visible;
        open = passed;
        // A visible crossing is not undertaken: the bits stay those before it; but the leaves on
        // its other side are kept, for met().
        for (std::uint32_t w = 0; w < tables_.surface_words; ++w) {
            const Mask here = visible & ((nearest >> 6) == all_lanes(std::int64_t{w}));
            bits[w] ^= here & (all_lanes(std::int64_t{1}) << (nearest & 63));
        }
        for (std::uint32_t w = 0; w < words; ++w) {
            before_[w] = select(passed, after_[w], before_[w]);
            met_after_[w] = select(visible, after_[w], met_after_[w]);
        }
        if (!any(open))
            return found;
        for (std::uint32_t s = 0; s < tables_.surface_count; ++s) {
            const Mask crossed = passed & (nearest == all_lanes(std::int64_t{s}));
            first_[s] = select(crossed, second_[s], first_[s]);
            second_[s] = select(crossed, never(), second_[s]);
        }
    }
}

/// Raises the failure when there is no filler.
template <class WordOf>
std::int32_t Walker::resolved(std::int32_t filler, WordOf&& word_of) {
    if (filler != unresolved)
        return filler;
    if (!failed_)
        overlapping_pair(tables_, word_of, overlapping_);
    failed_ = true;
    return none;
}

Met Walker::met(const Visible& visible, int lane) {
    const std::uint32_t words = tables_.leaf_words;
    Met m;
    m.surface = static_cast<std::int32_t>(visible.surface[lane]);
    const LaneSet before(before_.data(), words, lane), after(met_after_.data(), words, lane);
    const auto entered = [&](std::uint32_t w) { return after.word(w) & ~before.word(w); };
    const auto lowest = [&](auto&& set) {
        std::int32_t leaf = none;
        for_each_bit(words, set, [&](std::int32_t i) { return leaf = i, false; });
        return leaf;
    };
    const auto chosen = [&](auto&& set) {
        const std::int32_t filler = filler_of(tables_, set);
        return filler == unresolved ? lowest(set) : filler;
    };
    bool is_empty = true;
    for (std::uint32_t w = 0; w < words; ++w)
        is_empty &= before.word(w) == 0;
    if (is_empty) {
        m.leaf = chosen(entered);
        return m;
    }
    const std::int32_t filler = filler_[lane];
    const std::uint64_t* shows = tables_.shows_in + static_cast<std::size_t>(filler) * words;
    const auto entered_to_be_seen = [&](std::uint32_t w) { return entered(w) & shows[w]; };
    if (lowest(entered_to_be_seen) != none) {
        m.leaf = chosen(entered_to_be_seen);
        m.beyond = filler;
        return m;
    }
    m.leaf = filler;
    m.leaving = true;
    const std::uint64_t* displaced =
        tables_.displaced_by + static_cast<std::size_t>(filler) * words;
    const auto beyond = [&](std::uint32_t w) {
        return (after.word(w) & displaced[w]) | entered(w);
    };
    m.beyond = resolved(filler_of(tables_, beyond), beyond);
    return m;
}

} // namespace
} // namespace fraja::kernel
