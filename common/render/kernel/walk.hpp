// What wide rays meet first: where what fills the space changes.
//
// First the crossings with every surface, two at most; from them, for every leaf, when the ray
// enters it, or leaves it. Formulas are evaluated in time, not at points: "from when on are all of
// them true" asks each part for the next time at which it is, until none moves.
#pragma once

#include "common/render/kernel/beam.hpp"
#include "common/render/kernel/roots.hpp"
#include "common/render/kernel/tables.hpp"
#include "common/render/kernel/wide.hpp"

#include <vector>

namespace fraja::kernel {
namespace {

/// What fills the space where leaves overlap and neither displaces all others.
constexpr std::int32_t unresolved = -2;

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

/// Whether a formula is true at a point; inside(surface) answers for the surfaces.
template <class Inside>
inline bool holds(const Tables& tables, const Node& node, const Inside& inside) {
    switch (node.kind) {
    case Node::Kind::never:
        return false;
    case Node::Kind::always:
        return true;
    case Node::Kind::literal:
        return inside(node.first) != node.negated;
    case Node::Kind::all:
    case Node::Kind::any:
        break;
    }
    const bool all = node.kind == Node::Kind::all;
    for (std::uint32_t i = 0; i < node.count; ++i)
        if (holds(tables, tables.nodes[node.first + i], inside) != all)
            return !all;
    return all;
}

/// One lane's set of leaves, as words.
class LaneSet {
public:
    LaneSet(const WideInt* words, int lane) : words_(words), lane_(lane) {}
    [[nodiscard]] std::uint64_t operator()(std::uint32_t w) const {
        return static_cast<std::uint64_t>(words_[w][lane_]);
    }

private:
    const WideInt* words_;
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

/// Wide rays' crossings with the surfaces, and what follows from them. One thread's.
class Walker {
public:
    explicit Walker(const Tables& tables)
        : tables_(tables), first_(tables.surface_count), second_(tables.surface_count),
          inside_(tables.surface_count), bits_(tables.surface_words), leaves_(tables.leaf_words),
          shown_(tables.leaf_words) {
        look_at_all();
    }

    /// From now on all leaves are looked at.
    void look_at_all();
    /// From now on only leaves that rays of the beam, which start outside of everything but (if it
    /// is not none) on `owner`, may enter; whether there are any. Composite ones, whose surfaces
    /// rays with state must keep track of, in any case if `all_composites`.
    bool look_along(const Beam& beam, std::int64_t owner, bool all_composites);

    /// The surface that is all that is in view: a half-space, a leaf. none otherwise.
    [[nodiscard]] std::int32_t only_plane() const {
        return surfaces_in_view() == 1 && in_view_[1].size() == 1 && composites_in_view_.empty()
                   ? static_cast<std::int32_t>(in_view_[1][0])
                   : none;
    }
    [[nodiscard]] std::size_t surfaces_in_view() const {
        std::size_t count = 0;
        for (const auto& surfaces : in_view_)
            count += surfaces.size();
        return count;
    }

    /// Of rays with state, the surfaces they start inside of, by word.
    [[nodiscard]] WideInt* bits() { return bits_.data(); }

    struct Found {
        Wide t;          ///< the limit where there is nothing
        WideInt leaf;    ///< none where there is nothing
        WideInt surface; ///< of it
    };
    // Where no leaf is composite and no surface shared (Tables::leaf_is_surface), what these take
    // is not compiled in without `composites`.

    /// The first entry into a leaf nearer than `limit`, of rays that are outside of everything.
    /// Where its leaf is none, but not its surface, it is the one of that surface.
    template <bool composites>
    Found first_entry(const WideRays& rays, Wide limit);
    /// Which active ones of them have any.
    template <bool composites>
    Mask meets_anything(const WideRays& rays, Mask active, Wide limit);
    /// Of rays in bits(), where `filler` fills the space (none; unresolved). A change that is the
    /// filler's is where a ray leaves it, any other where it enters.
    template <bool composites>
    Found first_change(const WideRays& rays, WideInt filler, Wide limit);
    /// Takes the rays of the last first_change() to what was found: bits() are those just before.
    template <bool composites>
    void settle(const Found& found, Mask hit);

    /// The leaves that the rays of bits() are in, by word; kept until the next call.
    template <bool composites>
    const WideInt* find_leaves();
    /// Fills bits() for rays that start anywhere.
    void find_inside(Wide3 origin, Wide3 dir);

private:
    /// When something first is what it is asked to be, and which surface brought it about: none if
    /// it is so from the start.
    struct Moment {
        Wide t;
        WideInt surface;
    };
    /// A crossing at 0 comes after it.
    static Moment before_start() { return {all_lanes(-1.0), all_lanes(std::int64_t{none})}; }
    Moment next_time(const Node& node, bool wanted, Moment from);
    Moment next_time_of_literal(const Node& node, bool wanted, Moment from);
    [[nodiscard]] bool crosses_by(Wide t, std::int64_t leaf) const;
    template <class F>
    void for_each_surface_in_view(F&& f) const;
    [[nodiscard]] bool may_enter(const Beam& beam, std::int64_t leaf, std::int64_t owner) const;
    void see(std::uint32_t surface);

    template <class Surface>
    void keep_sided_crossings(const Surface& surface, std::int64_t index, const WideRays& rays);
    void find_shown(WideInt filler);
    Mask holds(const Node& node, const WideInt* bits);
    Moment next_time_of_part(const Node& node, bool wanted, Moment from);
    template <bool composites>
    void consider(Found& found, Moment moment, std::int64_t leaf, Mask candidates, WideInt filler);
    [[nodiscard]] bool shows_in(std::int64_t filler, std::int64_t entered) const;
    [[nodiscard]] Mask shows_in(WideInt filler, std::int64_t leaf) const;
    [[nodiscard]] Mask shows_in(std::int64_t filler, WideInt leaves) const;

    const Tables& tables_;
    // By surface: its next crossing, and the one after; whether the rays start inside.
    std::vector<Wide> first_, second_;
    std::vector<Mask> inside_;
    std::vector<WideInt> bits_;
    std::vector<WideInt> leaves_;
    std::vector<WideInt> shown_; ///< by word of leaves, where the rays of first_change() start

    // What is looked at: surfaces, by kind, and composite leaves.
    std::vector<std::uint32_t> in_view_[surface_kinds];
    std::vector<std::uint32_t> composites_in_view_;
    std::vector<bool> seen_; ///< by surface
    bool all_in_view_ = false;
};

/// Calls f(surface, index) for each, with its own type.
template <class F>
FRAJA_WIDE void Walker::for_each_surface_in_view(F&& f) const {
    for (const std::uint32_t s : in_view_[0])
        f(tables_.spheres[s], std::int64_t{s});
    std::uint32_t first = tables_.sphere_count;
    for (const std::uint32_t s : in_view_[1])
        f(tables_.planes[s - first], std::int64_t{s});
    first += tables_.plane_count;
    for (const std::uint32_t s : in_view_[2])
        f(tables_.cylinders[s - first], std::int64_t{s});
    first += tables_.cylinder_count;
    for (const std::uint32_t s : in_view_[3])
        f(tables_.cones[s - first], std::int64_t{s});
}

inline void Walker::see(std::uint32_t surface) {
    if (seen_[surface])
        return;
    seen_[surface] = true;
    const std::uint32_t planes = tables_.sphere_count;
    const std::uint32_t cylinders = planes + tables_.plane_count;
    const std::uint32_t cones = cylinders + tables_.cylinder_count;
    in_view_[surface < planes      ? 0
             : surface < cylinders ? 1
             : surface < cones     ? 2
                                   : 3]
        .push_back(surface);
}

inline void Walker::look_at_all() {
    if (all_in_view_)
        return;
    all_in_view_ = true;
    for (auto& surfaces : in_view_)
        surfaces.clear();
    seen_.assign(tables_.surface_count, false);
    for (std::uint32_t s = 0; s < tables_.surface_count; ++s)
        see(s);
    composites_in_view_.assign(tables_.composite_leaves,
                               tables_.composite_leaves + tables_.composite_leaf_count);
}

inline bool Walker::look_along(const Beam& beam, std::int64_t owner, bool all_composites) {
    all_in_view_ = false;
    for (auto& surfaces : in_view_)
        surfaces.clear();
    composites_in_view_.clear();
    seen_.assign(tables_.surface_count, false);
    bool any_in_view = false;
    for (std::uint32_t s = 0; s < tables_.surface_count; ++s) {
        const std::int32_t leaf = tables_.leaf_of_surface[s];
        if (leaf != none && may_enter(beam, leaf, s == owner ? owner : none)) {
            see(s);
            any_in_view = true;
        }
    }
    for (std::uint32_t i = 0; i < tables_.composite_leaf_count; ++i) {
        const std::uint32_t index = tables_.composite_leaves[i];
        const Leaf& leaf = tables_.leaves[index];
        if (!all_composites && beam.misses(leaf.center, leaf.radius))
            continue;
        any_in_view = true;
        composites_in_view_.push_back(index);
        for (std::uint32_t s = 0; s < leaf.surface_count; ++s)
            see(tables_.leaf_surfaces[leaf.surface_begin + s]);
    }
    for (std::uint32_t s = 0; s < tables_.surface_count; ++s)
        if (!seen_[s])
            first_[s] = second_[s] = never();
    return any_in_view;
}

/// Of a leaf that is the inside of a surface; `owner`: that surface, if the rays start on it.
inline bool Walker::may_enter(const Beam& beam, std::int64_t leaf, std::int64_t owner) const {
    const Leaf& l = tables_.leaves[leaf];
    if (beam.misses(l.center, l.radius))
        return false;
    const std::uint32_t surface = l.root.first;
    const std::uint32_t first = tables_.sphere_count;
    if (surface < first + tables_.plane_count && surface >= first)
        return owner == none && !beam.stays_outside(tables_.planes[surface - first]);
    // A sphere or a cylinder that rays leave, they do not enter; a cone has another nappe.
    return owner == none || surface >= first + tables_.plane_count + tables_.cylinder_count;
}

FRAJA_WIDE Walker::Moment Walker::next_time_of_literal(const Node& node, bool wanted, Moment from) {
    const std::uint32_t s = node.first;
    const Mask so_at_first = (inside_[s] ^ (node.negated != wanted ? Mask{} : ~Mask{}));
    const Mask between = (from.t >= first_[s]) & (from.t < second_[s]);
    // So at first: not between the crossings. Else: only between them.
    const Wide t = so_at_first ? (between ? second_[s] : from.t)
                               : (from.t < first_[s] ? first_[s]
                                  : between          ? from.t
                                                     : never());
    const Mask moved = t > from.t;
    return {t, select(moved, all_lanes(std::int64_t{s}), from.surface)};
}

FRAJA_WIDE Walker::Moment Walker::next_time_of_part(const Node& node, bool wanted, Moment from) {
    return node.kind == Node::Kind::literal ? next_time_of_literal(node, wanted, from)
                                            : next_time(node, wanted, from);
}

inline Walker::Moment Walker::next_time(const Node& node, bool wanted, Moment from) {
    switch (node.kind) {
    case Node::Kind::never:
        return {wanted ? never() : from.t, from.surface};
    case Node::Kind::always:
        return {wanted ? from.t : never(), from.surface};
    case Node::Kind::literal:
        return next_time_of_literal(node, wanted, from);
    case Node::Kind::all:
    case Node::Kind::any:
        break;
    }
    const Node* const parts = tables_.nodes + node.first;
    if ((node.kind == Node::Kind::all) != wanted) { // one part is enough: the earliest
        Moment earliest = next_time_of_part(parts[0], wanted, from);
        for (std::uint32_t i = 1; i < node.count; ++i) {
            const Moment m = next_time_of_part(parts[i], wanted, from);
            const Mask earlier = m.t < earliest.t;
            earliest.t = select(earlier, m.t, earliest.t);
            earliest.surface = select(earlier, m.surface, earliest.surface);
        }
        return earliest;
    }
    // Every part is needed: on and on, until all are content with what the last one said.
    std::uint32_t content = 0;
    for (std::uint32_t i = 0;; i = i + 1 < node.count ? i + 1 : 0) {
        const Wide before = from.t;
        from = next_time_of_part(parts[i], wanted, from);
        const Mask ahead = from.t < never();
        if (!any(ahead))
            return from;
        content = any((from.t > before) & ahead) ? 1 : content + 1;
        if (content >= node.count)
            return from;
    }
}

/// Whether some ray crosses one of the leaf's surfaces by then: else nothing changes for the leaf.
FRAJA_WIDE bool Walker::crosses_by(Wide t, std::int64_t leaf) const {
    const Leaf& l = tables_.leaves[leaf];
    Wide first = never();
    for (std::uint32_t i = 0; i < l.surface_count; ++i)
        first = lesser(first_[tables_.leaf_surfaces[l.surface_begin + i]], first);
    return any((first <= t) & (first < never()));
}

/// Of two changes at one time, which only surfaces that leaves share make likely, an entry comes
/// before the filler's end, a leaf before those that it displaces, and of two that do not displace
/// each other the one that the scene lists first.
template <bool composites>
FRAJA_WIDE void Walker::consider(Found& found, Moment moment, std::int64_t leaf, Mask candidates,
                                 WideInt filler) {
    Mask better = candidates & (moment.t < found.t);
    if (composites && tables_.shared_surfaces) {
        const Mask tie = candidates & (moment.t == found.t) & (found.leaf >= 0);
        if (any(tie))
            better |= tie & (filler != all_lanes(leaf)) &
                      ((found.leaf == filler) | shows_in(found.leaf, leaf) |
                       ((found.leaf > all_lanes(leaf)) & ~shows_in(leaf, found.leaf)));
    }
    found.t = select(better, moment.t, found.t);
    found.leaf = select(better, all_lanes(leaf), found.leaf);
    found.surface = select(better, moment.surface, found.surface);
}

template <bool composites>
Walker::Found Walker::first_entry(const WideRays& rays, Wide limit) {
    const WideInt nothing = all_lanes(std::int64_t{none});
    Found found{limit, nothing, nothing};
    for_each_surface_in_view([&](const auto& surface, std::int64_t index) {
        if (!composites || tables_.leaf_of_surface[index] != none) {
            const Wide entry = entry_of(surface, index, rays);
            const Mask nearer = entry < found.t;
            found.t = select(nearer, entry, found.t);
            found.surface = select(nearer, all_lanes(index), found.surface);
        }
        if (composites && tables_.in_composite[index])
            keep_sided_crossings(surface, index, rays);
    });
    if constexpr (!composites)
        return found;
    if (tables_.shared_surfaces) // for ties
        for (int lane = 0; lane < lanes; ++lane)
            if (found.surface[lane] >= 0)
                found.leaf[lane] = tables_.leaf_of_surface[found.surface[lane]];
    for (const std::uint32_t leaf : composites_in_view_) {
        if (!crosses_by(found.t, leaf))
            continue;
        const Moment entry = next_time(tables_.leaves[leaf].root, true, before_start());
        consider<composites>(found, entry, leaf, entry.surface != nothing, nothing);
    }
    return found;
}

template <bool composites>
Mask Walker::meets_anything(const WideRays& rays, Mask active, Wide limit) {
    Mask clear = active;
    for_each_surface_in_view([&](const auto& surface, std::int64_t index) {
        if (!composites || tables_.leaf_of_surface[index] != none)
            clear &= ~(entry_of(surface, index, rays) < limit);
        if (composites && tables_.in_composite[index])
            keep_sided_crossings(surface, index, rays);
    });
    if constexpr (!composites)
        return active & ~clear;
    for (const std::uint32_t leaf : composites_in_view_) {
        if (!any(clear))
            break;
        if (!crosses_by(limit, leaf))
            continue;
        const Node& root = tables_.leaves[leaf].root;
        const Moment entry = next_time(root, true, before_start());
        clear &= ~((entry.t < limit) & (entry.surface != all_lanes(std::int64_t{none})));
    }
    return active & ~clear;
}

template <class Surface>
FRAJA_WIDE void Walker::keep_sided_crossings(const Surface& surface, std::int64_t index,
                                             const WideRays& rays) {
    const auto s = static_cast<std::size_t>(index);
    const SidedCrossings c = sided_crossings_of(surface, index, rays);
    first_[s] = c.crossings.first, second_[s] = c.crossings.second;
    inside_[s] = c.inside;
}

/// Whether leaf `entered` shows when it is entered where `filler` fills the space.
FRAJA_WIDE bool Walker::shows_in(std::int64_t filler, std::int64_t entered) const {
    return (tables_.shows_in[static_cast<std::size_t>(filler) * tables_.leaf_words +
                             static_cast<std::size_t>(entered >> 6)] >>
                (entered & 63) &
            1) != 0;
}

/// Of each lane: whether a leaf shows when it is entered where that filler fills the space.
FRAJA_WIDE Mask Walker::shows_in(WideInt filler, std::int64_t leaf) const {
    if (!tables_.any_relations)
        return Mask{};
    Mask shows{};
    for (int lane = 0; lane < lanes; ++lane)
        if (filler[lane] >= 0)
            shows[lane] = shows_in(filler[lane], leaf) ? -1 : 0;
    return shows;
}
/// Likewise, of a leaf in each lane.
FRAJA_WIDE Mask Walker::shows_in(std::int64_t filler, WideInt leaves) const {
    if (!tables_.any_relations)
        return Mask{};
    Mask shows{};
    for (int lane = 0; lane < lanes; ++lane)
        if (leaves[lane] >= 0)
            shows[lane] = shows_in(filler, leaves[lane]) ? -1 : 0;
    return shows;
}

/// Fills shown_: the leaves that show when entered where that filler fills the space. Outside, all.
FRAJA_WIDE void Walker::find_shown(WideInt filler) {
    for (std::uint32_t w = 0; w < tables_.leaf_words; ++w)
        for (int lane = 0; lane < lanes; ++lane) {
            const std::int64_t f = filler[lane];
            shown_[w][lane] =
                f < 0 ? (f == none ? -1 : 0)
                      : static_cast<std::int64_t>(
                            tables_.shows_in[static_cast<std::size_t>(f) * tables_.leaf_words + w]);
        }
}

template <bool composites>
Walker::Found Walker::first_change(const WideRays& rays, WideInt filler, Wide limit) {
    const Mask lost = filler == all_lanes(std::int64_t{unresolved}); // any change will tell
    const bool all_outside = !any(filler != all_lanes(std::int64_t{none}));
    const WideInt nothing = all_lanes(std::int64_t{none});
    Found found{limit, nothing, nothing};
    if (!all_outside)
        find_shown(filler);
    const auto may_show = [&](std::int64_t leaf) {
        return all_outside ? ~Mask{} : bit_at(shown_.data(), leaf);
    };
    for_each_surface_in_view([&](const auto& surface, std::int64_t index) {
        const auto s = static_cast<std::size_t>(index);
        inside_[s] = bit_at(bits_.data(), index);
        const Crossings c = crossings_of(surface, index, rays, inside_[s]);
        first_[s] = c.first, second_[s] = c.second;
        const std::int64_t leaf = composites ? tables_.leaf_of_surface[index] : index;
        if (leaf != none)
            consider<composites>(
                found, {c.first, all_lanes(index)}, leaf,
                (may_show(leaf) & ~inside_[s]) | (filler == all_lanes(leaf)) | lost, filler);
    });
    if constexpr (!composites)
        return found;
    const Moment start = before_start();
    for (const std::int64_t leaf : composites_in_view_) {
        if (!crosses_by(found.t, leaf))
            continue;
        const Node& root = tables_.leaves[leaf].root;
        if (const Mask enters = may_show(leaf) | lost; any(enters)) {
            const Moment entry = next_time(root, true, start);
            consider<composites>(found, entry, leaf, enters & (entry.surface != nothing), filler);
        }
        const Mask within = (filler == all_lanes(leaf)) | lost;
        if (any(within)) {
            const Moment end = next_time(root, false, start);
            consider<composites>(found, end, leaf, within & (end.surface != nothing), filler);
        }
    }
    return found;
}

template <bool composites>
void Walker::settle(const Found& found, Mask hit) {
    for (std::uint32_t s = 0; s < tables_.surface_count; ++s) {
        const Mask met = found.surface == all_lanes(std::int64_t{s});
        // Of two leaves that are surfaces, entered at one time, the other one is still ahead; of a
        // composite leaf's surfaces, crossed at one time, all are behind.
        const Mask ahead_at_hit = composites && tables_.in_composite[s] ? met : ~Mask{};
        const Mask crossed = ahead_at_hit ? (first_[s] < found.t) ^ ((second_[s] < found.t) & ~met)
                                          : (first_[s] <= found.t) ^ (second_[s] <= found.t);
        bits_[s >> 6] ^=
            hit & crossed & all_lanes(static_cast<std::int64_t>(std::uint64_t{1} << (s & 63)));
    }
}

inline Mask Walker::holds(const Node& node, const WideInt* bits) {
    switch (node.kind) {
    case Node::Kind::never:
        return Mask{};
    case Node::Kind::always:
        return ~Mask{};
    case Node::Kind::literal:
        return node.negated ? ~bit_at(bits, node.first) : bit_at(bits, node.first);
    case Node::Kind::all:
    case Node::Kind::any:
        break;
    }
    const bool all = node.kind == Node::Kind::all;
    Mask result = all ? ~Mask{} : Mask{};
    for (std::uint32_t i = 0; i < node.count; ++i) {
        const Mask part = holds(tables_.nodes[node.first + i], bits);
        result = all ? result & part : result | part;
    }
    return result;
}

template <bool composites>
const WideInt* Walker::find_leaves() {
    if (!composites || tables_.leaf_is_surface)
        return bits_.data();
    for (WideInt& word : leaves_)
        word = WideInt{};
    for (std::uint32_t i = 0; i < tables_.leaf_count; ++i)
        leaves_[i >> 6] |= holds(tables_.leaves[i].root, bits_.data()) &
                           all_lanes(static_cast<std::int64_t>(std::uint64_t{1} << (i & 63)));
    return leaves_.data();
}

void Walker::find_inside(Wide3 origin, Wide3 dir) {
    for (WideInt& word : bits_)
        word = WideInt{};
    for_each_surface_in_view([&](const auto& surface, std::int64_t index) {
        bits_[static_cast<std::size_t>(index >> 6)] |=
            starts_inside(surface, origin, dir) &
            all_lanes(static_cast<std::int64_t>(std::uint64_t{1} << (index & 63)));
    });
}

} // namespace
} // namespace fraja::kernel
