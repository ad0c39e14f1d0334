// rays [--repeat N] [-r WxH] SCENE.raj...
//
// What it costs to find what a ray hits, by kind: camera rays, one shadow ray for each hit and
// light that faces it, one mirror ray for each hit of a sphere that stands apart, sorted by octant
// in blocks as a wave is. Traversal alone: no shading, no sorting. User-mode cycles per ray of one
// thread, with a hash of what was hit. Scenes whose rays carry state (glass) are refused.
#include "common/base/text.hpp"
#include "common/render/kernel/dispatch.hpp"
#include "common/render/kernel/program.hpp"
#include "common/scene/raj_reader.hpp"
#include "tools/bench/measure.hpp"

#include <bit>
#include <cmath>
#include <limits>
#include <vector>

namespace fraja {
namespace {

using kernel::none;
using kernel::Tables;

constexpr std::size_t packet = 16;
constexpr std::uint32_t block = 32; ///< pixels, each way

class Rays {
public:
    void add(const Vec3& from, const Vec3& to, double limit, std::int64_t owner) {
        for (int c = 0; c < 3; ++c)
            origin_[c].push_back(from[c]), dir_[c].push_back(to[c]);
        limits_.push_back(limit), owners_.push_back(owner);
    }
    [[nodiscard]] std::size_t size() const { return limits_.size(); }
    [[nodiscard]] Vec3 origin(std::size_t i) const {
        return {origin_[0][i], origin_[1][i], origin_[2][i]};
    }
    [[nodiscard]] Vec3 dir(std::size_t i) const { return {dir_[0][i], dir_[1][i], dir_[2][i]}; }
    [[nodiscard]] double t(std::size_t i) const { return t_[i]; }
    [[nodiscard]] std::int64_t surface(std::size_t i) const { return surface_[i]; }

    /// The least cycles of some runs.
    double trace(const kernel::KernelEntry& entry, const Tables& tables,
                 const CycleCounter& counter, bool any_hit, std::uint64_t repeat) {
        if (size() == 0)
            return 0;
        while (limits_.size() % packet != 0) { // copies, as a wave is filled up
            const std::size_t last = limits_.size() - 1;
            add(origin(last), dir(last), limits_[last], owners_[last]);
            ++padding_;
        }
        double best = 0;
        for (std::uint64_t run = 0; run < std::max<std::uint64_t>(repeat, 1); ++run) {
            t_ = limits_, surface_ = owners_;
            const double begin = counter.now();
            entry.find_hits(tables, {size(),
                                     {origin_[0].data(), origin_[1].data(), origin_[2].data()},
                                     {dir_[0].data(), dir_[1].data(), dir_[2].data()},
                                     t_.data(),
                                     surface_.data(),
                                     any_hit});
            const double cycles = counter.now() - begin;
            if (run == 0 || cycles < best)
                best = cycles;
        }
        return best;
    }
    [[nodiscard]] std::size_t traced() const { return size() - padding_; }
    [[nodiscard]] std::uint64_t hash() const { // FNV-1a
        std::uint64_t hash = 0xcbf29ce484222325;
        for (std::size_t i = 0; i < traced(); ++i)
            for (const std::uint64_t bits :
                 {std::bit_cast<std::uint64_t>(t_[i]), static_cast<std::uint64_t>(surface_[i])})
                hash = (hash ^ bits) * 0x100000001b3;
        return hash;
    }

private:
    std::vector<double> origin_[3], dir_[3], limits_, t_;
    std::vector<std::int64_t> owners_, surface_;
    std::size_t padding_ = 0;
};

Vec3 vec(const double (&v)[3]) {
    return {v[0], v[1], v[2]};
}

/// In blocks, and in these in squares of four by four.
Rays camera_rays(const Tables& tables, Extent size) {
    Rays rays;
    const kernel::CameraTable& camera = tables.camera;
    for (std::uint32_t by = 0; by < size.height; by += block)
        for (std::uint32_t bx = 0; bx < size.width; bx += block)
            for (std::uint32_t i = 0; i < block * block; ++i) {
                const std::uint32_t square = i / 16, in_square = i % 16;
                const std::uint32_t x = bx + square % 8 * 4 + in_square % 4;
                const std::uint32_t y = by + square / 8 * 4 + in_square / 4;
                if (x >= size.width || y >= size.height)
                    continue;
                const Vec3 place = vec(camera.top_left) +
                                   ((x + 0.5) / size.width) * vec(camera.rightwards) +
                                   ((y + 0.5) / size.height) * vec(camera.downwards);
                rays.add(place, normalized(place - vec(camera.origin)),
                         std::numeric_limits<double>::infinity(), none);
            }
    return rays;
}

struct Hit {
    Vec3 place, normal;
    std::int64_t surface;
};

Hit hit_of(const Tables& tables, const Rays& rays, std::size_t i) {
    const std::int64_t surface = rays.surface(i);
    const Vec3 place = rays.origin(i) + rays.t(i) * rays.dir(i);
    const auto apart = surface - std::int64_t{tables.surface_count};
    if (apart >= 0)
        return {place, normalized(place - vec(tables.bvh_spheres[apart].center)), surface};
    const auto s = static_cast<std::uint32_t>(surface);
    if (s < tables.sphere_count)
        return {place, normalized(place - vec(tables.spheres[s].center)), surface};
    if (s < tables.sphere_count + tables.plane_count)
        return {place, vec(tables.planes[s - tables.sphere_count].normal), surface};
    fail("only spheres and planes, please");
}

Rays shadow_rays(const Tables& tables, const Rays& camera) {
    Rays rays;
    constexpr std::size_t batch = std::size_t{block} * block;
    for (std::size_t begin = 0; begin < camera.size(); begin += batch)
        for (std::uint32_t l = 0; l < tables.light_count; ++l)
            for (std::size_t i = begin; i < std::min(begin + batch, camera.traced()); ++i) {
                if (camera.surface(i) == none)
                    continue;
                const Hit hit = hit_of(tables, camera, i);
                const kernel::Light& light = tables.lights[l];
                const Vec3 way = light.point ? vec(light.to) - hit.place : vec(light.to);
                const double distance = light.point ? length(way) : 1;
                if (dot(way, hit.normal) > 0)
                    rays.add(hit.place, way / distance,
                             light.point ? distance : std::numeric_limits<double>::infinity(),
                             hit.surface);
            }
    return rays;
}

Rays mirror_rays(const Tables& tables, const Rays& camera) {
    Rays rays;
    constexpr std::size_t batch = std::size_t{block} * block;
    for (std::size_t begin = 0; begin < camera.size(); begin += batch)
        for (int octant = 0; octant < 8; ++octant)
            for (std::size_t i = begin; i < std::min(begin + batch, camera.traced()); ++i) {
                if (camera.surface(i) < std::int64_t{tables.surface_count})
                    continue;
                const Hit hit = hit_of(tables, camera, i);
                const Vec3 d = camera.dir(i);
                const Vec3 mirrored = normalized(d - (2 * dot(d, hit.normal)) * hit.normal);
                const int its = (mirrored.x < 0) | (mirrored.y < 0) << 1 | (mirrored.z < 0) << 2;
                if (its == octant)
                    rays.add(hit.place, mirrored, std::numeric_limits<double>::infinity(),
                             hit.surface);
            }
    return rays;
}

int run(int argc, char** argv) {
    Extent size{1024, 1024};
    std::uint64_t repeat = 3;
    std::vector<std::string> scenes;
    for (int i = 1; i < argc; ++i) {
        const std::string word = argv[i];
        if (word == "--repeat") {
            const auto n = parse_count(argv[++i] ? argv[i] : "");
            if (!n)
                fail("--repeat takes a number");
            repeat = *n;
        } else if (word == "-r") {
            size = extent_of(argv[++i]);
        } else if (word.starts_with("-")) {
            fail("what is " + word + "?");
        } else {
            scenes.push_back(word);
        }
    }
    if (scenes.empty())
        fail("rays [--repeat N] [-r WxH] SCENE.raj...");
    const CycleCounter counter;
    const auto entry = kernel::chosen_entry();
    if (!entry)
        fail(entry.error().message);
    std::printf("%s, %s, %ux%u, best of %llu\n", (*entry)->isa,
                counter.counts() ? "cycles counted by the processor"
                                 : "cycles from time and a measured clock rate",
                size.width, size.height, static_cast<unsigned long long>(repeat));
    std::printf("%-20s %-10s %9s %9s  %s\n", "scene", "rays", "million", "cycles", "hash");
    for (const std::string& path : scenes) {
        const auto scene = read_raj_file(path);
        if (!scene)
            fail(scene.error().message);
        const auto program = kernel::Program::compile(*scene);
        if (!program || program->tables().stateful)
            fail(path + ": its rays carry state");
        const Tables& tables = program->tables();
        const auto show = [&](const char* kind, Rays& rays, bool any_hit) {
            const double cycles = rays.trace(**entry, tables, counter, any_hit, repeat);
            std::printf("%-20s %-10s %9.3f %9.1f  %016llx\n",
                        path.substr(path.find_last_of('/') + 1).c_str(), kind,
                        1e-6 * static_cast<double>(rays.traced()),
                        cycles / static_cast<double>(std::max<std::size_t>(rays.traced(), 1)),
                        static_cast<unsigned long long>(rays.hash()));
        };
        Rays camera = camera_rays(tables, size);
        show("primary", camera, false);
        Rays shadow = shadow_rays(tables, camera);
        show("shadow", shadow, true);
        Rays mirrored = mirror_rays(tables, camera);
        show("reflected", mirrored, false);
    }
    return 0;
}

} // namespace
} // namespace fraja

int main(int argc, char** argv) {
    return fraja::run(argc, argv);
}
