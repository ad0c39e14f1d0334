// The surfaces of a scene, each once.
#pragma once

#include "common/geometry/forms.hpp"
#include "common/render/kernel/tables.hpp"

#include <array>
#include <cstdint>
#include <initializer_list>
#include <map>
#include <vector>

namespace fraja::kernel {

/// A side of a surface: what a primitive form fills.
struct Side {
    std::uint32_t surface = 0;
    bool negated = false; ///< the outside
};

/// Collects surfaces; forms that are the same set of points get the same one.
class SurfaceCollector {
public:
    /// `center` is subtracted from every place.
    explicit SurfaceCollector(const Vec3& center) : center_(center) {}

    /// What a form fills, or, if `complement`, what it leaves. Numbers are those of collection.
    Side add(const Form& form, bool complement);
    [[nodiscard]] std::size_t size() const { return order_.size(); }

    /// The same surfaces in the order of Tables.
    struct Sorted {
        std::vector<SphereSurface> spheres;
        std::vector<PlaneSurface> planes;
        std::vector<CylinderSurface> cylinders;
        std::vector<ConeSurface> cones;
        std::vector<std::uint32_t> new_number; ///< by number of collection

        [[nodiscard]] std::size_t size() const {
            return spheres.size() + planes.size() + cylinders.size() + cones.size();
        }
        /// How far a point is from the inside of a surface, negative inside; of a cone, at least.
        struct Sided {
            double side, error;
        };
        [[nodiscard]] Sided side_of(std::uint32_t surface, const Vec3& p) const;
        /// Leaves out what is not used; answers the number that each surface has now.
        std::vector<std::uint32_t> keep(const std::vector<bool>& used);
    };
    [[nodiscard]] Sorted sorted() const;

private:
    /// Bits of what makes a surface what it is: numbers that are none have an order, too.
    using Key = std::array<std::uint64_t, 8>;
    static Key key_of(SurfaceKind kind, std::initializer_list<double> numbers);
    Side add(const Sphere&, bool complement);
    Side add(const Plane&, bool complement);
    Side add(const Cylinder&, bool complement);
    Side add(const Cone&, bool complement);
    template <class Table, class Entry>
    std::uint32_t add(SurfaceKind kind, Table& table, const Key& key, const Entry& entry);

    struct Place {
        SurfaceKind kind;
        std::uint32_t index;
    };
    Vec3 center_;
    std::vector<Place> order_;
    std::map<Key, std::uint32_t> known_;
    std::vector<SphereSurface> spheres_;
    std::vector<PlaneSurface> planes_;
    std::vector<CylinderSurface> cylinders_;
    std::vector<ConeSurface> cones_;
};

[[nodiscard]] double side_of(const SphereSurface& s, const Vec3& p);

/// `center` is subtracted from its place.
[[nodiscard]] SphereSurface surface_of(const Sphere& sphere, const Vec3& center);

} // namespace fraja::kernel
