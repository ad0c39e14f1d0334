#include "common/render/kernel/bounds.hpp"

#include "tests/support/seeds.hpp"

#include <cmath>
#include <doctest/doctest.h>

namespace fraja::kernel {
namespace {

/// A formula over forms, as a scene would make it.
class Formula {
public:
    Expression form(const Form& form, bool complement = false) {
        const Side side = collector_.add(form, complement);
        return Expression::inside(side.surface, side.negated);
    }
    BoundingSphere around(Expression e) {
        sorted_ = collector_.sorted();
        renumber(e);
        formula_ = e;
        return bounding_sphere(e, sorted_);
    }
    /// Of the last around().
    [[nodiscard]] bool contains(const Vec3& p) const {
        return formula_.holds([&](std::uint32_t s) { return sorted_.side_of(s, p).side <= 0; });
    }

private:
    void renumber(Expression& e) const {
        if (e.kind == Expression::Kind::literal)
            e.surface = sorted_.new_number[e.surface];
        for (Expression& part : e.parts)
            renumber(part);
    }

    SurfaceCollector collector_{Vec3{}};
    SurfaceCollector::Sorted sorted_;
    Expression formula_;
};

Vec3 in_box(Rng& rng, double half) {
    const double x = rng.between(-half, half), y = rng.between(-half, half);
    return {x, y, rng.between(-half, half)};
}

constexpr auto all = Expression::Kind::all;
constexpr auto any_of = Expression::Kind::any;

TEST_CASE("endless forms have no bound, a sphere has itself, nothing has less than none") {
    Formula f;
    CHECK(std::isinf(f.around(f.form(Plane{{0, 0, 0}, {0, 0, 1}})).radius));
    CHECK(std::isinf(f.around(f.form(Cylinder{{0, 0, 0}, {0, 0, 1}, 1})).radius));
    CHECK(std::isinf(f.around(f.form(Cone{{0, 0, 0}, {0, 0, 1}, 0.5})).radius));
    CHECK(std::isinf(f.around(f.form(Sphere{{1, 2, 3}, 2}, true)).radius));
    const BoundingSphere ball = f.around(f.form(Sphere{{1, 2, 3}, 2}));
    CHECK(ball.center == Vec3{1, 2, 3});
    CHECK(ball.radius == doctest::Approx(2));
    CHECK(f.around(Expression::constant(false)).radius < 0);
    CHECK(std::isinf(f.around(Expression::constant(true)).radius));
}

TEST_CASE("a capped cylinder and a capped cone are bounded closely") {
    Formula f;
    const auto top = f.form(Plane{{0, 0, 2}, {0, 0, 1}}),
               floor = f.form(Plane{{0, 0, 0}, {0, 0, -1}});
    const auto tube =
        Expression::joined(all, {f.form(Cylinder{{5, 0, 9}, {0, 0, 3}, 1}), top, floor});
    CHECK(f.around(tube).radius == doctest::Approx(std::sqrt(2.0)));
    const auto cone =
        Expression::joined(all, {f.form(Cone{{0, 0, 3}, {0, 0, 1}, std::atan(0.5)}), top, floor});
    CHECK(f.around(cone).radius == doctest::Approx(std::sqrt(1 + 1.5 * 1.5)));
    const auto open = Expression::joined(all, {f.form(Cylinder{{5, 0, 9}, {0, 0, 3}, 1}), top});
    CHECK(std::isinf(f.around(open).radius));
}

TEST_CASE("what a formula contains is within its bounds") {
    for_each_seed(2'000, [](Rng& rng) {
        Formula f;
        std::vector<Expression> pieces;
        for (std::uint64_t n = 1 + rng.below(2); n > 0; --n) {
            std::vector<Expression> parts;
            for (std::uint64_t m = 2 + rng.below(8); m > 0; --m) {
                Vec3 dir = in_box(rng, 1);
                dir.z += 2;
                const Vec3 place = in_box(rng, 2);
                switch (rng.below(5)) {
                case 0:
                    parts.push_back(f.form(Cylinder{place, dir, rng.between(0.2, 2)}));
                    break;
                case 1:
                    parts.push_back(f.form(Cone{place, dir, rng.between(0.1, 1.2)}));
                    break;
                default:
                    parts.push_back(f.form(Plane{place, in_box(rng, 1)}, rng.below(2) == 0));
                }
            }
            pieces.push_back(Expression::joined(all, parts));
        }
        const BoundingSphere b = f.around(Expression::joined(any_of, pieces));
        for (int i = 0; i < 200; ++i) {
            const Vec3 p = in_box(rng, 20);
            if (f.contains(p))
                CHECK(length(p - b.center) <= b.radius);
        }
    });
}

TEST_CASE("a cube of six planes is bounded, however it stands; of five it is not") {
    for_each_seed(500, [](Rng& rng) {
        Formula f;
        const Vec3 u = normalized(in_box(rng, 1)), v = normalized(cross(u, in_box(rng, 1)));
        const Vec3 center = in_box(rng, 5);
        std::vector<Expression> planes;
        for (const Vec3& n : {u, v, cross(u, v)})
            for (const double sign : {-1.0, 1.0})
                planes.push_back(f.form(Plane{center + sign * n, sign * n}));
        const BoundingSphere b = f.around(Expression::joined(all, planes));
        CHECK(b.radius == doctest::Approx(std::sqrt(3.0)).epsilon(1e-4));
        CHECK(length(b.center - center) < 1e-4);
        planes.pop_back();
        CHECK(std::isinf(f.around(Expression::joined(all, planes)).radius));
    });
}

} // namespace
} // namespace fraja::kernel
