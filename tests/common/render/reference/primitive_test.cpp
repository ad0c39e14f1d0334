#include "common/render/reference/primitive.hpp"

#include "tests/support/seeds.hpp"

#include <cmath>
#include <doctest/doctest.h>
#include <initializer_list>
#include <vector>

namespace fraja::reference {
namespace {

constexpr FormIndex self{7};

Vec3 random_vec(Rng& rng, double side) {
    const double x = rng.between(-side, side), y = rng.between(-side, side);
    return {x, y, rng.between(-side, side)};
}

Form random_form(Rng& rng) {
    const Vec3 origin = random_vec(rng, 2), direction = random_vec(rng, 1);
    switch (rng.below(4)) {
    case 0:
        return Sphere{origin, rng.between(0.1, 2)};
    case 1:
        return Plane{origin, direction};
    case 2:
        return Cylinder{origin, direction, rng.between(0.1, 2)};
    default:
        return Cone{origin, direction, rng.between(0.1, 1.4)};
    }
}

TEST_CASE("forms are met where they are") {
    struct Row {
        Form form;
        double x; ///< of the hit of a ray from (-5, 0, 0) along x
        Vec3 normal;
    };
    const double slope = std::atan(0.5);
    const double s = std::sin(slope), c = std::cos(slope);
    for (const Row& row : {Row{Sphere{{0, 0, 0}, 1}, -1, {-1, 0, 0}},
                           Row{Sphere{{0, 0, 0}, -1}, -1, {-1, 0, 0}}, // its square counts
                           Row{Plane{{2, 0, 0}, {-3, 0, 0}}, 2, {-1, 0, 0}},
                           Row{Cylinder{{0, 0, 9}, {0, 0, 4}, 2}, -2, {-1, 0, 0}},
                           Row{Cone{{0, 0, 2}, {0, 0, 1}, slope}, -1, {-c, 0, s}},
                           Row{Cone{{0, 0, -2}, {0, 0, 1}, slope}, -1, {-c, 0, -s}}}) {
        const Primitive form = make_primitive(self, row.form);
        const auto hit = intersect(form, make_ray({{-5, 0, 0}}, {2, 0, 0}));
        REQUIRE(hit.has_value());
        CHECK(hit->owner == self);
        CHECK(hit->position.x == doctest::Approx(row.x));
        CHECK(length(normal(form, hit->position) - row.normal) < 1e-12);
    }
}

TEST_CASE("a hit lies on the surface, within nothing but its own form") {
    for_each_seed(2'000, [](Rng& rng) {
        const Primitive form = make_primitive(self, random_form(rng));
        const Ray ray = make_ray({random_vec(rng, 5)}, random_vec(rng, 1));
        const auto hit = intersect(form, ray);
        if (!hit)
            return;
        CHECK(contains(form, *hit));
        CHECK(!strictly_contains(form, *hit));
        const Vec3 n = normal(form, hit->position);
        CHECK(length(n) == doctest::Approx(1));
        CHECK(strictly_contains(form, {hit->position - 1e-6 * n}));
        CHECK(!contains(form, {hit->position + 1e-6 * n}));
    });
}

TEST_CASE("a ray that leaves a surface meets it again only from the other side") {
    for_each_seed(2'000, [](Rng& rng) {
        const Primitive form = make_primitive(self, random_form(rng));
        const auto hit = intersect(form, make_ray({random_vec(rng, 5)}, random_vec(rng, 1)));
        if (!hit)
            return;
        const Ray onwards = make_ray(*hit, random_vec(rng, 1));
        const auto next = intersect(form, onwards);
        if (!next)
            return;
        CHECK(!std::holds_alternative<UnitPlane>(form.shape));
        CHECK(dot(normal(form, hit->position), onwards.dir) *
                  dot(normal(form, next->position), onwards.dir) <=
              0);
    });
}

TEST_CASE("normals are finite everywhere") {
    for (const Form& form : {Form{Sphere{{1, 2, 3}, 1}}, Form{Cylinder{{1, 2, 3}, {0, 0, 1}, 1}},
                             Form{Cone{{1, 2, 3}, {0, 1, 0}, 0.5}}, Form{Cone{{1, 2, 3}, {}, 0}}})
        for (const Vec3& p :
             {Vec3{1, 2, 3}, Vec3{1, 2, 4}, Vec3{1e300, 2, 3}, Vec3{1 + 1e-16, 2, 3}})
            CHECK(is_finite(normal(make_primitive(self, form), p)));
    CHECK(normal(make_primitive(self, Cone{{1, 2, 3}, {0, 2, 0}, 0.5}), {1, 2, 3}) ==
          Vec3{0, 1, 0});
}

TEST_CASE("a ray without direction or place meets nothing") {
    const double nan = std::nan("");
    for_each_seed(50, [&](Rng& rng) {
        const Primitive form = make_primitive(self, random_form(rng));
        CHECK(!intersect(form, make_ray({random_vec(rng, 5)}, {0, 0, 0})));
        CHECK(!intersect(form, make_ray({{nan, 0, 0}}, {1, 0, 0})));
        CHECK(!intersect(form, make_ray({{HUGE_VAL, 0, 0}}, {-1, 0, 0})));
    });
}

} // namespace
} // namespace fraja::reference
