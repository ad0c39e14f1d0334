#include "client/preview/sixel.hpp"

#include <cstddef>
#include <dlfcn.h>
#include <memory>

namespace fraja::client {
namespace {

constexpr const char* library_name = "libchafa.so.0";

// What is needed of chafa 1, as its documentation has it (its headers want GLib's):
// https://hpjansson.org/chafa/ref/. The name of the library promises that it stays so.
struct CanvasConfig;
struct Canvas;
struct TermInfo;
struct GString {
    char* str;
    std::size_t len, allocated_len;
};
constexpr int pixel_mode_sixels = 1, pixel_type_rgb8 = 8, dither_mode_none = 0;

struct Chafa {
    CanvasConfig* (*config_new)() = nullptr;
    void (*config_unref)(CanvasConfig*) = nullptr;
    void (*set_geometry)(CanvasConfig*, int width, int height) = nullptr;
    void (*set_cell_geometry)(CanvasConfig*, int width, int height) = nullptr;
    void (*set_pixel_mode)(CanvasConfig*, int mode) = nullptr;
    void (*set_dither_mode)(CanvasConfig*, int mode) = nullptr;
    Canvas* (*canvas_new)(const CanvasConfig*) = nullptr;
    void (*canvas_unref)(Canvas*) = nullptr;
    void (*draw)(Canvas*, int pixel_type, const std::uint8_t* pixels, int width, int height,
                 int row_bytes) = nullptr;
    GString* (*print)(Canvas*, TermInfo*) = nullptr;
    char* (*string_free)(GString*, int with_text) = nullptr;
    void (*set_n_threads)(int) = nullptr;
};

Result<Chafa> load() {
    const auto failed = [](const std::string& why) {
        return Error{ErrorCode::io, why +
                                        " (sixels need it: install libchafa0, or choose --preview "
                                        "blocks)"};
    };
    void* const handle = ::dlopen(library_name, RTLD_LAZY | RTLD_LOCAL);
    if (!handle)
        return failed(::dlerror());
    std::string missing;
    const auto find = [&]<class F>(F*& function, const char* name) {
        function = reinterpret_cast<F*>(::dlsym(handle, name));
        if (!function)
            missing = name;
    };
    Chafa c;
    find(c.config_new, "chafa_canvas_config_new");
    find(c.config_unref, "chafa_canvas_config_unref");
    find(c.set_geometry, "chafa_canvas_config_set_geometry");
    find(c.set_cell_geometry, "chafa_canvas_config_set_cell_geometry");
    find(c.set_pixel_mode, "chafa_canvas_config_set_pixel_mode");
    find(c.set_dither_mode, "chafa_canvas_config_set_dither_mode");
    find(c.canvas_new, "chafa_canvas_new");
    find(c.canvas_unref, "chafa_canvas_unref");
    find(c.draw, "chafa_canvas_draw_all_pixels");
    find(c.print, "chafa_canvas_print");
    find(c.string_free, "g_string_free");
    find(c.set_n_threads, "chafa_set_n_threads");
    if (!missing.empty())
        return failed(std::string(library_name) + " has no " + missing);
    c.set_n_threads(1); // the machine has better to do
    return c;
}

const Result<Chafa>& chafa() {
    static const Result<Chafa> loaded = load();
    return loaded;
}

} // namespace

Result<void> check_sixel() {
    if (!chafa())
        return chafa().error();
    return {};
}

Result<std::string> sixel_image(const LevelsPicture& levels) {
    if (!chafa())
        return chafa().error();
    const Chafa& c = *chafa();
    const auto width = static_cast<int>(levels.extent.width);
    const auto height = static_cast<int>(levels.extent.height);
    const std::unique_ptr<CanvasConfig, void (*)(CanvasConfig*)> config(c.config_new(),
                                                                        c.config_unref);
    // Cells of a pixel: it draws in whole ones.
    c.set_geometry(config.get(), width, height);
    c.set_cell_geometry(config.get(), 1, 1);
    c.set_pixel_mode(config.get(), pixel_mode_sixels);
    c.set_dither_mode(config.get(), dither_mode_none);
    const std::unique_ptr<Canvas, void (*)(Canvas*)> canvas(c.canvas_new(config.get()),
                                                            c.canvas_unref);
    c.draw(canvas.get(), pixel_type_rgb8, levels.rgb.data(), width, height, 3 * width);
    GString* const printed = c.print(canvas.get(), nullptr);
    std::string text(printed->str, printed->len);
    c.string_free(printed, 1);
    return text;
}

} // namespace fraja::client
