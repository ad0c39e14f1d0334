// Forms that are the same set of points are one surface.
#include "common/render/kernel/surfaces.hpp"

#include "common/render/kernel/dispatch.hpp"
#include "common/render/kernel/render.hpp"
#include "tests/support/scene_builder.hpp"

#include <doctest/doctest.h>
#include <limits>
#include <memory>

namespace fraja::kernel {
namespace {

TEST_CASE("forms in other words are one surface, seen from the same side or the other") {
    SurfaceCollector collector{Vec3{}};
    const auto add = [&](const Form& form, bool complement) {
        return collector.add(form, complement);
    };
    const Side cylinder = add(Cylinder{{1, 2, 3}, {0, 0, 2}, 0.5}, false);
    CHECK(add(Cylinder{{1, 2, -7}, {0, 0, -1}, -0.5}, false).surface == cylinder.surface);
    CHECK(add(Cylinder{{1, 2, 3}, {0, 0, 2}, 0.5}, true).negated != cylinder.negated);
    const Side plane = add(Plane{{0, 0, 4}, {0, 0, 1}}, false);
    const Side below = add(Plane{{5, 6, 4}, {0, 0, -3}}, false);
    CHECK(below.surface == plane.surface);
    CHECK(below.negated != plane.negated);
    CHECK(add(Sphere{{0, 0, 1}, 2}, false).surface == add(Sphere{{-0.0, 0, 1}, -2}, false).surface);
    CHECK(collector.size() == 3);
}

TEST_CASE("and others are not") {
    SurfaceCollector collector{Vec3{}};
    const auto add = [&](const Form& form, bool complement) {
        return collector.add(form, complement);
    };
    (void)add(Cylinder{{1, 2, 3}, {0, 0, 2}, 0.5}, false);
    (void)add(Cylinder{{1, 2.5, 3}, {0, 0, 2}, 0.5}, false);
    (void)add(Cylinder{{1, 2, 3}, {0, 1, 2}, 0.5}, false);
    (void)add(Cylinder{{1, 2, 4}, {0, 1, 2}, 0.5}, false);
    (void)add(Cone{{1, 2, 3}, {0, 0, 2}, 0.5}, false);
    const double none = std::numeric_limits<double>::quiet_NaN();
    (void)add(Sphere{{none, 2, 3}, 0.5}, false);
    (void)add(Sphere{{1, 2, 3}, 0.5}, false);
    (void)add(Sphere{{none, 2, 3}, 0.5}, false); // once more
    CHECK(collector.size() == 7);
}

TEST_CASE("a scene with more spheres than the hierarchy can number is another kernel's") {
    SceneBuilder b;
    std::vector<SolidIndex> members;
    for (int i = 0; i < 30; ++i)
        members.push_back(b.solid(Sphere{{5.0 + i, 0, 0}, 0.3}, matte(0.5)));
    b.aggregate(members);
    const auto scene = std::make_shared<const Scene>(b.scene);
    const KernelEntry& entry = *usable_entries().back();
    CHECK(compile_for(entry, scene, {.spheres_apart_max = 30}) != nullptr);
    CHECK(compile_for(entry, scene, {.spheres_apart_max = 29}) == nullptr);
}

} // namespace
} // namespace fraja::kernel
