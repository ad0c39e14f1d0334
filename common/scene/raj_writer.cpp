#include "common/scene/raj_writer.hpp"

#include "common/base/assert.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <charconv>
#include <cstdint>
#include <string_view>
#include <unordered_map>
#include <unordered_set>

namespace fraja {
namespace {

constexpr std::size_t number_bytes_max = 512; // -1.8e308 and 5e-324 without exponents fit

bool can_be_label(std::string_view label) {
    return label.starts_with('@') && std::ranges::all_of(label.substr(1), [](char c) {
               return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') ||
                      c == '_' || c == '.';
           });
}

bool same_bits(double a, double b) {
    return std::bit_cast<std::uint64_t>(a) == std::bit_cast<std::uint64_t>(b);
}

/// One table's labels: who needs one, and who has been written already.
struct Labels {
    explicit Labels(std::size_t count) : use_counts(count), names(count), written(count) {}
    std::vector<std::uint32_t> use_counts;
    std::vector<std::string> names; ///< with '@'; empty: none
    std::vector<bool> written;
};

/// Counts how often each entry is referred to, from what is reached alone.
class UseCounter {
public:
    UseCounter(const Scene& scene, Labels& forms, Labels& textures, Labels& textured_forms,
               Labels& solids)
        : scene_(scene), forms_(forms), textures_(textures), textured_forms_(textured_forms),
          solids_(solids) {}

    void use(SolidIndex i) {
        if (solids_.use_counts[as_size(i)]++ == 0)
            std::visit(*this, scene_.solids[as_size(i)]);
    }
    void use(TexturedFormIndex i) {
        if (textured_forms_.use_counts[as_size(i)]++ == 0)
            std::visit(*this, scene_.textured_forms[as_size(i)]);
    }
    void use(const Volume& volume) {
        if (const auto* solid = std::get_if<SolidIndex>(&volume))
            use(*solid);
    }

    void operator()(const BasicTexturedForm& b) {
        ++forms_.use_counts[as_size(b.form)];
        ++textures_.use_counts[as_size(b.texture_in)];
        if (b.texture_out != b.texture_in)
            ++textures_.use_counts[as_size(b.texture_out)];
    }
    void operator()(const Union& u) {
        for (const TexturedFormIndex member : u.members)
            use(member);
    }
    void operator()(const Intersection& n) {
        for (const TexturedFormIndex member : n.members)
            use(member);
    }
    void operator()(const Complement& c) { use(c.of); }
    void operator()(const BasicSolid& b) { use(b.textured_form), use(b.volume); }
    void operator()(const Aggregate& a) {
        const std::unordered_set<SolidIndex> members(a.members.begin(), a.members.end());
        for (const SolidIndex member : a.members)
            use(member);
        for (const Priority& priority : a.priorities) {
            FRAJA_ASSERT(members.contains(priority.above) && members.contains(priority.below));
            use(priority.above), use(priority.below);
        }
    }

private:
    const Scene& scene_;
    Labels &forms_, &textures_, &textured_forms_, &solids_;
};

class Writer {
public:
    explicit Writer(const Scene& scene)
        : scene_(scene), forms_(scene.forms.size()), textures_(scene.textures.size()),
          textured_forms_(scene.textured_forms.size()), solids_(scene.solids.size()) {}

    std::string write() {
        UseCounter counter(scene_, forms_, textures_, textured_forms_, solids_);
        counter.use(scene_.world.solid);
        counter.use(scene_.world.ambient_volume);
        name_all();
        put("raja.renderer.Scene {");
        write_world();
        std::visit([this](const auto& camera) { write_camera(camera); }, scene_.camera);
        put("\n}\n");
        return std::move(out_);
    }

private:
    // ---------------------------------------------------------------------------------- labels

    void name_all() {
        std::unordered_map<std::string_view, int> bearers;
        for (const SolidName& name : scene_.solid_names)
            ++bearers[name.label];
        for (std::size_t i = 0; i < scene_.solid_names.size(); ++i)
            if (const std::string& label = scene_.solid_names[i].label;
                can_be_label(label) && bearers[label] == 1)
                solids_.names[i] = label;
        const auto taken = [&](const std::string& name) { return bearers.contains(name); };
        name_shared(forms_, "@form_", taken);
        name_shared(textures_, "@texture_", taken);
        name_shared(textured_forms_, "@part_", taken);
        name_shared(solids_, "@solid_", taken);
    }

    template <class Taken>
    static void name_shared(Labels& labels, std::string_view prefix, const Taken& taken) {
        for (std::size_t i = 0; i < labels.names.size(); ++i) {
            if (labels.use_counts[i] < 2 || !labels.names[i].empty())
                continue;
            std::string name = std::string(prefix) + std::to_string(i);
            while (taken(name))
                name += '_';
            labels.names[i] = std::move(name);
        }
    }

    /// Writes the label alone if the entry has been written before; else says false, and the caller
    /// writes the entry, beginning with its head.
    template <class Index>
    bool refer(Labels& labels, Index i) {
        if (!labels.written[as_size(i)])
            return false;
        FRAJA_ASSERT(!labels.names[as_size(i)].empty());
        put(labels.names[as_size(i)]);
        return true;
    }
    /// The class and, for others to refer to, the label.
    template <class Index>
    void put_head(Labels& labels, Index i, std::string_view class_name) {
        put(class_name);
        if (const std::string& name = labels.names[as_size(i)]; !name.empty())
            put(" (", name, ")");
        labels.written[as_size(i)] = true;
    }

    // ------------------------------------------------------------------------ text and numbers

    struct NumberField {
        std::string_view name;
        double value;
    };
    struct TripleField {
        std::string_view name, class_name;
        Vec3 value;
    };
    static TripleField point(std::string_view name, const Vec3& v) {
        return {name, "raja.Point3D", v};
    }
    static TripleField vector(std::string_view name, const Vec3& v) {
        return {name, "raja.Vector3D", v};
    }
    static TripleField rgb(std::string_view name, const Rgb& v) { return {name, "raja.RGB", v}; }
    static NumberField number(std::string_view name, double value) { return {name, value}; }

    template <class... Parts>
    void put(const Parts&... parts) {
        (add(parts), ...);
    }
    template <class... Parts>
    void put_line(const Parts&... parts) {
        out_ += '\n';
        out_.append(2 * depth_, ' ');
        put(parts...);
    }
    /// The line that closes a block.
    void put_end(std::string_view text) {
        --depth_;
        put_line(text);
    }

    void add(std::string_view text) { out_ += text; }
    void add(double value) {
        std::array<char, number_bytes_max> text;
        const auto [last, error] =
            std::to_chars(text.data(), text.data() + text.size(), value, std::chars_format::fixed);
        FRAJA_ASSERT(error == std::errc{});
        out_.append(text.data(), last);
    }
    void add(const NumberField& f) { put(f.name, " = ", f.value); }
    void add(const TripleField& f) {
        put(f.name, " = ", f.class_name, " { ", f.value.x, " ; ", f.value.y, " ; ", f.value.z,
            " }");
    }
    void put_grey_or_rgb(std::string_view name, const Rgb& v) {
        if (same_bits(v.x, v.y) && same_bits(v.x, v.z))
            put(number(name, v.x), " ");
        else
            put(rgb(name, v), " ");
    }

    // ----------------------------------------------------------------------- forms and textures

    void write(FormIndex i) {
        if (!refer(forms_, i))
            std::visit([&](const auto& form) { write_form(i, form); }, scene_.forms[as_size(i)]);
    }
    void write_form(FormIndex i, const Sphere& s) {
        put_head(forms_, i, "raja.shape.Sphere");
        put(" { ", point("center", s.center), " ", number("radius", s.radius), " }");
    }
    void write_form(FormIndex i, const Plane& p) {
        put_head(forms_, i, "raja.shape.Plane");
        put(" { ", point("origin", p.origin), " ", vector("normal", p.normal), " }");
    }
    void write_form(FormIndex i, const Cylinder& c) {
        put_head(forms_, i, "raja.shape.Cylinder");
        put(" { ", point("origin", c.origin), " ", vector("direction", c.direction), " ",
            number("radius", c.radius), " }");
    }
    void write_form(FormIndex i, const Cone& c) {
        put_head(forms_, i, "raja.shape.Cone");
        put(" { ", point("origin", c.origin), " ", vector("direction", c.direction), " ",
            number("angle", c.angle_rad), " }");
    }

    void write(TextureIndex i) {
        if (!refer(textures_, i))
            std::visit([&](const auto& t) { write_texture(i, t); }, scene_.textures[as_size(i)]);
    }
    void write_texture(TextureIndex i, const PlainTexture& t) {
        put_head(textures_, i, "raja.shape.PlainTexture");
        put(" { localTexture = raja.shape.LocalTexture { ");
        put_grey_or_rgb("kd", t.local.kd);
        put_grey_or_rgb("krl", t.local.krl);
        put_grey_or_rgb("krg", t.local.krg);
        put("ktl = 0 ");
        put_grey_or_rgb("ktg", t.local.ktg);
        put(number("ns", t.local.ns), " nt = 1 } }");
    }
    void write_texture(TextureIndex i, const ChequeredTexture& t) {
        using Pattern = ChequeredTexture::Pattern;
        put_head(textures_, i,
                 t.pattern == Pattern::damier   ? "raja.test.DamierTexture"
                 : t.pattern == Pattern::hamier ? "raja.test.HamierTexture"
                                                : "raja.test.MamierTexture");
        put(" { ", rgb("kdUn", t.kd_one), " ", rgb("kdDeux", t.kd_two), " ", rgb("kr", t.kr), " ",
            rgb("kt", t.kt), " ", number("ns", t.ns), " nt = 1 ", number("step", t.step), " ",
            number("x", t.x), " ", number("y", t.y), " }");
    }

    // -------------------------------------------------------------------- textured forms, solids

    void write(TexturedFormIndex i) {
        if (!refer(textured_forms_, i))
            std::visit([&](const auto& t) { write_textured_form(i, t); },
                       scene_.textured_forms[as_size(i)]);
    }
    void write_textured_form(TexturedFormIndex i, const BasicTexturedForm& b) {
        put_head(textured_forms_, i, "raja.shape.BasicTexturedForm");
        put(" {");
        ++depth_;
        put_line("form = ");
        write(b.form);
        put_line(b.texture_in == b.texture_out ? "texture = " : "textureIn = ");
        write(b.texture_in);
        if (b.texture_in != b.texture_out) {
            put_line("textureOut = ");
            write(b.texture_out);
        }
        put_end("}");
    }
    void write_textured_form(TexturedFormIndex i, const Union& u) {
        put_head(textured_forms_, i, "raja.shape.Union");
        put(" { texturedForms = ");
        write_list(u.members);
        put(" }");
    }
    void write_textured_form(TexturedFormIndex i, const Intersection& n) {
        put_head(textured_forms_, i, "raja.shape.Intersection");
        put(" { texturedForms = ");
        write_list(n.members);
        put(" }");
    }
    void write_textured_form(TexturedFormIndex i, const Complement& c) {
        put_head(textured_forms_, i, "raja.shape.Complement");
        put(" { texturedForm = ");
        write(c.of);
        put(" }");
    }

    void write(SolidIndex i) {
        if (!refer(solids_, i))
            std::visit([&](const auto& solid) { write_solid(i, solid); },
                       scene_.solids[as_size(i)]);
    }
    void write_solid(SolidIndex i, const BasicSolid& b) {
        put_head(solids_, i, "raja.shape.BasicSolid");
        put(" {");
        ++depth_;
        put_line("texturedForm = ");
        write(b.textured_form);
        write_volume("volume", b.volume);
        put_end("}");
    }
    void write_solid(SolidIndex i, const Aggregate& a) {
        put_head(solids_, i, "raja.shape.Aggregate");
        put(" {");
        ++depth_;
        put_line("solids = ");
        write_list(a.members);
        put_line("priorities = [[");
        std::string_view separator = " ";
        for (const Priority& priority : a.priorities) {
            put(separator);
            write(priority.above);
            put(" >> ");
            write(priority.below);
            separator = ", ";
        }
        put(" ]]");
        put_end("}");
    }
    template <class Index>
    void write_list(const std::vector<Index>& members) {
        put("[");
        ++depth_;
        for (std::size_t i = 0; i < members.size(); ++i) {
            put(i == 0 ? "" : ",");
            put_line();
            write(members[i]);
        }
        put_end("]");
    }
    /// A line of its own, or nothing for the index that is the default.
    void write_volume(std::string_view name, const Volume& volume) {
        if (const auto* solid = std::get_if<SolidIndex>(&volume)) {
            put_line(name, " = ");
            write(*solid);
        } else if (const auto& v = std::get<IsotropicVolume>(volume); v != IsotropicVolume{}) {
            put_line(name, " = raja.shape.IsotropicVolume { ", v.refractive_index, " }");
        }
    }

    // ------------------------------------------------------------------------------ world, camera

    void write_world() {
        const World& world = scene_.world;
        put_line("world = raja.renderer.World {");
        ++depth_;
        put_line("solid = ");
        write(world.solid);
        put_line("lights = [");
        ++depth_;
        for (std::size_t i = 0; i < world.lights.size(); ++i) {
            put(i == 0 ? "" : ",");
            put_line();
            std::visit([this](const auto& light) { write_light(light); }, world.lights[i]);
        }
        put_end("]");
        put_line(rgb("ambiantLight", world.ambient_light));
        put_line(rgb("backgroundLight", world.background_light));
        write_volume("ambiantVolume", world.ambient_volume);
        put_end("}");
    }
    void write_light(const PointLight& l) {
        put("raja.light.PointLightSource { ", point("origin", l.origin), " ", rgb("light", l.light),
            " }");
    }
    void write_light(const DirectionalLight& l) {
        put("raja.light.DirectionalLightSource { ", vector("direction", l.direction), " ",
            rgb("light", l.light), " }");
    }

    void write_camera(const HorizontalCamera& c) {
        put_line("camera = raja.renderer.HorizontalCamera {");
        ++depth_;
        write_eye(c);
        put_end("}");
    }
    void write_camera(const StereoCamera& c) {
        put_line("camera = raja.renderer.StereoCamera {");
        ++depth_;
        write_eye(c.eye);
        put_line(number("step", c.step));
        put_end("}");
    }
    void write_eye(const HorizontalCamera& c) {
        put_line(point("origin", c.origin), " ", vector("direction", c.direction));
        put_line(number("focal", c.focal), " ", number("screenWidth", c.screen_width), " ",
                 number("screenHeight", c.screen_height));
    }

    const Scene& scene_;
    Labels forms_, textures_, textured_forms_, solids_;
    std::string out_;
    std::size_t depth_ = 1;
};

} // namespace

std::string write_raj(const Scene& scene) {
    return Writer(scene).write();
}

} // namespace fraja
