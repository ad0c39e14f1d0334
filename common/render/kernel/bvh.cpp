#include "common/render/kernel/bvh.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>

namespace fraja::kernel {
namespace {

/// Spheres tested one by one.
constexpr std::uint32_t leaf_spheres_max = 4;
constexpr std::size_t bins = 16;
/// Below so many levels halves are split, not areas: spheres can be placed so that each split by
/// area parts off one. 2^28 spheres make 28 levels more.
constexpr std::uint32_t area_levels_max = bvh_levels_max - 32;
/// What a step through a node of eight boxes costs, in tests of a sphere.
constexpr double node_cost = 3;

struct Box {
    std::array<double, 3> low{1e300, 1e300, 1e300}, high{-1e300, -1e300, -1e300};

    void add(const Box& o) {
        for (std::size_t c = 0; c < 3; ++c) {
            low[c] = std::min(low[c], o.low[c]);
            high[c] = std::max(high[c], o.high[c]);
        }
    }
    [[nodiscard]] double half_area() const {
        const double x = high[0] - low[0], y = high[1] - low[1], z = high[2] - low[2];
        return x < 0 ? 0 : x * y + y * z + z * x;
    }
    /// Never infinite, nor is the sum of all boxes'.
    [[nodiscard]] double finite_half_area() const {
        const double area = half_area();
        return area < 1e280 ? area : 1e280;
    }
};

Box point_box(const std::array<double, 3>& p) {
    return {p, p};
}
Box box_of(const SphereSurface& s) {
    Box box;
    for (std::size_t c = 0; c < 3; ++c)
        box.low[c] = s.center[c] - s.radius, box.high[c] = s.center[c] + s.radius;
    return box;
}

/// A node of the hierarchy two ways.
struct Binary {
    Box box;
    std::uint32_t begin = 0, count = 0; ///< spheres in order
    std::uint32_t left = 0, right = 0;  ///< 0: one sphere
    std::uint32_t level = 0;
};

class Builder {
public:
    explicit Builder(const std::vector<SphereSurface>& spheres) : spheres_(spheres) {
        bvh_.order.resize(spheres.size());
        std::iota(bvh_.order.begin(), bvh_.order.end(), 0u);
    }

    Bvh build() {
        if (spheres_.empty())
            return std::move(bvh_);
        binary_.reserve(spheres_.size());
        divide(add(0, static_cast<std::uint32_t>(spheres_.size())));
        find_cuts();
        bvh_.nodes.emplace_back();
        widen();
        return std::move(bvh_);
    }

private:
    std::uint32_t add(std::uint32_t begin, std::uint32_t count) {
        Binary node;
        node.begin = begin, node.count = count;
        for (std::uint32_t i = begin; i < begin + count; ++i)
            node.box.add(box_of(spheres_[bvh_.order[i]]));
        binary_.push_back(node);
        return static_cast<std::uint32_t>(binary_.size() - 1);
    }

    [[nodiscard]] double center(std::uint32_t nth, std::size_t axis) const {
        return spheres_[bvh_.order[nth]].center[axis];
    }

    void divide(std::uint32_t root) {
        std::vector<std::uint32_t> open{root};
        while (!open.empty()) {
            const std::uint32_t index = open.back();
            open.pop_back();
            const std::uint32_t begin = binary_[index].begin, count = binary_[index].count;
            const std::uint32_t left_count = split(index);
            if (left_count == 0)
                continue;
            const std::uint32_t left = add(begin, left_count);
            const std::uint32_t right = add(begin + left_count, count - left_count);
            binary_[index].left = left, binary_[index].right = right;
            binary_[left].level = binary_[right].level = binary_[index].level + 1;
            open.push_back(left), open.push_back(right);
        }
    }

    /// Where to divide a node: spheres with centres in bins below `bin` of an axis go left.
    struct Split {
        std::size_t axis = 0, bin = 0;
        double low = 0, scale = 0; ///< of the bins
        double cost = std::numeric_limits<double>::infinity();
        std::uint32_t left_count = 0;

        [[nodiscard]] std::size_t bin_of(const SphereSurface& s) const {
            return std::min(static_cast<std::size_t>((s.center[axis] - low) * scale), bins - 1);
        }
    };

    /// The best by surface area along an axis.
    [[nodiscard]] Split best_split(const Binary& node, std::size_t axis, double low,
                                   double extent) const {
        Split split;
        split.axis = axis, split.low = low, split.scale = static_cast<double>(bins) / extent;
        if (!(extent > 0) || !std::isfinite(split.scale) || !std::isfinite(extent))
            return split;
        std::array<Box, bins> boxes;
        std::array<std::uint32_t, bins> counts{};
        for (std::uint32_t i = node.begin; i < node.begin + node.count; ++i) {
            const SphereSurface& sphere = spheres_[bvh_.order[i]];
            const std::size_t b = split.bin_of(sphere);
            boxes[b].add(box_of(sphere));
            ++counts[b];
        }
        std::array<double, bins> right_cost{}; // of the bins from one on
        Box right;
        std::uint32_t right_count = 0;
        for (std::size_t b = bins - 1; b > 0; --b) {
            right.add(boxes[b]);
            right_count += counts[b];
            right_cost[b] = right.half_area() * right_count;
        }
        Box left;
        std::uint32_t left_count = 0;
        for (std::size_t b = 1; b < bins; ++b) {
            left.add(boxes[b - 1]);
            left_count += counts[b - 1];
            const double cost = left.half_area() * left_count + right_cost[b];
            if (left_count > 0 && left_count < node.count && cost < split.cost)
                split.bin = b, split.cost = cost, split.left_count = left_count;
        }
        return split;
    }

    /// Reorders the spheres of a node; how many go left. 0: it is one sphere.
    std::uint32_t split(std::uint32_t index) {
        const Binary& node = binary_[index];
        if (node.count <= 1)
            return 0;
        Box centers;
        for (std::uint32_t i = node.begin; i < node.begin + node.count; ++i)
            centers.add(point_box({center(i, 0), center(i, 1), center(i, 2)}));
        Split best;
        if (node.level < area_levels_max && std::isfinite(node.box.half_area()))
            for (std::size_t axis = 0; axis < 3; ++axis) {
                const Split split = best_split(node, axis, centers.low[axis],
                                               centers.high[axis] - centers.low[axis]);
                if (split.cost < best.cost)
                    best = split;
            }
        if (best.left_count == 0) // in one place, or absurdly small, or great
            return node.count / 2;
        const auto first = bvh_.order.begin() + node.begin;
        std::stable_partition(first, first + node.count, [&](std::uint32_t sphere) {
            return best.bin_of(spheres_[sphere]) < best.bin;
        });
        return best.left_count;
    }

    /// How a subtree is best cut into at most n parts, each a leaf or a wide node.
    struct Cut {
        std::array<double, bvh_width> cost{};           ///< [n - 1]
        std::array<std::uint8_t, bvh_width + 1> left{}; ///< [n]: parts of the left child; 0: n - 1
        bool leaf = true;                               ///< as one part: else a wide node
    };

    /// By cost, surface areas times steps: H. Ylitie, T. Karras, S. Laine, "Efficient Incoherent
    /// Ray Traversal on GPUs Through Compressed Wide BVHs" (2017), section 3.2.
    void find_cuts() {
        cuts_.resize(binary_.size());
        for (std::size_t i = binary_.size(); i-- > 0;) { // children come after their parents
            const Binary& node = binary_[i];
            Cut& cut = cuts_[i];
            const double area = node.box.finite_half_area();
            const double leaf_cost = node.count <= leaf_spheres_max
                                         ? area * node.count
                                         : std::numeric_limits<double>::infinity();
            if (node.left == 0) {
                cut.cost.fill(leaf_cost);
                continue;
            }
            std::array<double, bvh_width + 1> divided; // into n parts at most, one each side
            for (std::size_t n = 2; n <= bvh_width; ++n) {
                divided[n] = std::numeric_limits<double>::infinity();
                for (std::size_t k = 1; k < n; ++k) {
                    const double cost =
                        cuts_[node.left].cost[k - 1] + cuts_[node.right].cost[n - k - 1];
                    if (cost < divided[n])
                        divided[n] = cost, cut.left[n] = static_cast<std::uint8_t>(k);
                }
            }
            const double node_of_its_own = node_cost * area + divided[bvh_width];
            cut.leaf = leaf_cost <= node_of_its_own;
            cut.cost[0] = std::min(leaf_cost, node_of_its_own);
            for (std::size_t n = 2; n < bvh_width; ++n) {
                const bool fewer = cut.cost[n - 2] <= divided[n];
                cut.cost[n - 1] = fewer ? cut.cost[n - 2] : divided[n];
                if (fewer)
                    cut.left[n] = 0;
            }
        }
    }

    /// The parts of a subtree cut into `n` at most.
    void add_parts(std::uint32_t index, std::size_t n, std::vector<std::uint32_t>& parts) const {
        const Cut& cut = cuts_[index];
        while (n > 1 && n < bvh_width && cut.left[n] == 0)
            --n;
        if (n == 1 || binary_[index].left == 0) {
            parts.push_back(index);
            return;
        }
        add_parts(binary_[index].left, cut.left[n], parts);
        add_parts(binary_[index].right, n - cut.left[n], parts);
    }

    void widen() {
        struct Open {
            std::uint32_t from, to;
        };
        std::vector<Open> open{{0, 0}};
        std::vector<std::uint32_t> children;
        while (!open.empty()) {
            const Open at = open.back();
            open.pop_back();
            children.clear();
            add_parts(at.from, bvh_width, children);
            BvhNode node = empty_node();
            for (std::size_t i = 0; i < children.size(); ++i) {
                const Binary& child = binary_[children[i]];
                set_box(node, i, child.box);
                if (cuts_[children[i]].leaf) {
                    node.child[i] =
                        ~static_cast<std::int32_t>(child.begin << 3 | (child.count - 1));
                    continue;
                }
                node.child[i] = static_cast<std::int32_t>(bvh_.nodes.size());
                open.push_back({children[i], static_cast<std::uint32_t>(bvh_.nodes.size())});
                bvh_.nodes.emplace_back();
            }
            bvh_.nodes[at.to] = node;
        }
    }

    static BvhNode empty_node() {
        BvhNode node{};
        for (int c = 0; c < 3; ++c)
            for (std::size_t i = 0; i < bvh_width; ++i) {
                node.low[c][i] = std::numeric_limits<float>::infinity();
                node.high[c][i] = -std::numeric_limits<float>::infinity();
            }
        return node;
    }

    static void set_box(BvhNode& node, std::size_t i, const Box& box) {
        constexpr float infinity = std::numeric_limits<float>::infinity();
        for (std::size_t c = 0; c < 3; ++c) { // rounded outwards
            const auto low = static_cast<float>(box.low[c]);
            const auto high = static_cast<float>(box.high[c]);
            node.low[c][i] =
                static_cast<double>(low) > box.low[c] ? std::nextafter(low, -infinity) : low;
            node.high[c][i] =
                static_cast<double>(high) < box.high[c] ? std::nextafter(high, infinity) : high;
        }
    }

    const std::vector<SphereSurface>& spheres_;
    std::vector<Binary> binary_;
    std::vector<Cut> cuts_; ///< by binary node
    Bvh bvh_;
};

} // namespace

Bvh build_bvh(const std::vector<SphereSurface>& spheres) {
    return Builder(spheres).build();
}

} // namespace fraja::kernel
