#include "common/image_io/picture_file.hpp"

#include "common/base/rng.hpp"
#include "tests/support/file_bytes.hpp"
#include "tests/support/folder.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <csignal>
#include <ctime>
#include <doctest/doctest.h>
#include <fstream>
#include <iterator>
#include <limits>
#include <sys/resource.h>
#include <unistd.h>

using namespace fraja;
namespace fs = std::filesystem;

namespace {

/// No file of this process grows beyond so many bytes while this lives: a full disk.
class FullDisk {
public:
    explicit FullDisk(rlim_t bytes) {
        old_handler_ = std::signal(SIGXFSZ, SIG_IGN);
        REQUIRE(::getrlimit(RLIMIT_FSIZE, &old_) == 0);
        const rlimit now{bytes, old_.rlim_max};
        REQUIRE(::setrlimit(RLIMIT_FSIZE, &now) == 0);
    }
    ~FullDisk() {
        ::setrlimit(RLIMIT_FSIZE, &old_);
        std::signal(SIGXFSZ, old_handler_);
    }
    FullDisk(const FullDisk&) = delete;
    FullDisk& operator=(const FullDisk&) = delete;

private:
    rlimit old_{};
    void (*old_handler_)(int) = SIG_DFL;
};

void put(const fs::path& path, std::string_view text) {
    std::ofstream(path, std::ios::binary) << text;
}

/// Every level in every channel, in an order without much of a pattern.
LevelsPicture all_levels() {
    LevelsPicture picture{{64, 12}, {}};
    for (std::uint32_t i = 0; i < 3 * 64 * 12; ++i)
        picture.rgb.push_back(static_cast<std::uint8_t>((i * 37 + i / 256) % 256));
    return picture;
}

/// Floats of all sizes, and what is left of a pixel that went wrong.
std::vector<float> odd_floats(std::size_t count) {
    using Limits = std::numeric_limits<float>;
    std::vector<float> rgb = {0.0f,
                              -0.0f,
                              1.0f,
                              0.1f,
                              -2.5f,
                              1e-30f,
                              Limits::max(),
                              Limits::min(),
                              Limits::denorm_min(),
                              Limits::infinity(),
                              Limits::quiet_NaN(),
                              65505.0f};
    while (rgb.size() < count)
        rgb.push_back(static_cast<float>(rgb.size()) / 7.0f);
    rgb.resize(count);
    return rgb;
}

/// A picture of that size of which `region` was drawn.
Film film_of(Extent size, PixelRect region, const std::vector<float>& rgb) {
    Film film(size, region);
    film.place({region, rgb});
    return film;
}

/// Likewise, with a different odd float for each pixel's samples and error.
Film film_with_estimates(Extent size, PixelRect region) {
    const std::size_t n = region.pixel_count();
    const auto floats = odd_floats(5 * n);
    const auto part = [&](std::size_t from, std::size_t count) {
        const auto begin = floats.begin() + static_cast<std::ptrdiff_t>(from);
        return std::vector(begin, begin + static_cast<std::ptrdiff_t>(count));
    };
    Film film(size, region, {.estimates = true});
    film.place({region, part(2 * n, 3 * n), part(0, n), part(n, n)});
    return film;
}

bool same_bits(const std::vector<float>& a, const std::vector<float>& b) {
    return std::ranges::equal(a, b, {}, std::bit_cast<std::uint32_t, float>,
                              std::bit_cast<std::uint32_t, float>);
}

} // namespace

TEST_CASE("8-bit formats hold the levels they were given") {
    const Folder folder;
    const LevelsPicture picture = all_levels();
    for (const char* name : {"a.png", "a.tif", "a.tiff", "a.bmp", "a.ppm", "a.tga", "A.PNG",
                             "a.dpx", "a.pnm", "a.tpic"}) {
        CAPTURE(name);
        REQUIRE(write_levels(folder / name, {picture.extent, picture.rgb}));
        const auto read = read_levels(folder / name);
        REQUIRE(read);
        CHECK(*read == picture);
    }
}

TEST_CASE("jpg and webp hold about the levels they were given") {
    const Folder folder;
    LevelsPicture smooth{{64, 64}, {}};
    for (std::uint32_t i = 0; i < 64 * 64; ++i)
        smooth.rgb.insert(smooth.rgb.end(), {static_cast<std::uint8_t>(i % 64 * 4),
                                             static_cast<std::uint8_t>(i / 64 * 4), 128});
    struct Row {
        const char* name;
        int worst;
    };
    for (const Row& row : {Row{"a.jpg", 4}, Row{"a.jfif", 4}, Row{"a.webp", 6}}) {
        CAPTURE(row.name);
        REQUIRE(write_levels(folder / row.name, {smooth.extent, smooth.rgb}));
        const auto read = read_levels(folder / row.name);
        REQUIRE(read);
        REQUIRE(read->rgb.size() == smooth.rgb.size());
        int worst = 0;
        for (std::size_t i = 0; i < smooth.rgb.size(); ++i)
            worst = std::max(worst, std::abs(int{read->rgb[i]} - int{smooth.rgb[i]}));
        CHECK(worst <= row.worst);
    }
}

TEST_CASE("hdr holds the colours' floats to a share of the brightest, and nothing else") {
    const Folder folder;
    const PixelRect window{3, 4, 6, 5};
    const Film film = film_of({10, 10}, window, [&] {
        std::vector<float> rgb;
        for (std::size_t i = 0; i < 3 * window.pixel_count(); ++i)
            rgb.push_back(static_cast<float>(i * i) / 7.0f);
        return rgb;
    }());
    CHECK(pixel_kind("a.hdr").value() == PixelKind::radiance);
    REQUIRE(write_picture(folder / "a.hdr", film, {{{"fraja:scene", "00ff"}}}, {.half = true}));
    CHECK(bytes_of(folder / "a.hdr").find("00ff") == std::string::npos);
    const auto read = read_radiance(folder / "a.hdr");
    REQUIRE(read);
    CHECK(read->extent == Extent{6, 5});
    CHECK(read->window == PixelRect{0, 0, 6, 5});
    CHECK(read->channels.empty());
    REQUIRE(read->rgb.size() == film.pixels().size());
    for (std::size_t i = 0; i < read->rgb.size(); i += 3)
        for (std::size_t c = 0; c < 3; ++c) // one exponent for the three
            CHECK(std::abs(read->rgb[i + c] - film.pixels()[i + c]) <= film.pixels()[i + 2] / 128);
    REQUIRE(write_picture(folder / "estimates.hdr", film_with_estimates({10, 10}, window)));
    CHECK(read_radiance(folder / "estimates.hdr").value().channels.empty());
}

TEST_CASE("a format that is not written well is refused before anything is rendered") {
    const Folder folder;
    struct Row {
        const char *name, *why;
    };
    for (const Row& row :
         {Row{"a.gif", "256 colours"}, Row{"a.jp2", "an empty file"}, Row{"a.iff", "crashes"},
          Row{"a.pgm", "no colours"}, Row{"a.avif", ".heic"}, Row{"a.sgi", "in memory"},
          Row{"a.null", "holds nothing"}}) {
        CAPTURE(row.name);
        const auto kind = pixel_kind(folder / row.name);
        REQUIRE_FALSE(kind);
        CHECK(kind.error().code == ErrorCode::invalid_argument);
        CHECK(kind.error().message.find(row.why) != std::string::npos);
        CHECK(kind.error().message.find("use one of .png") != std::string::npos);
        CHECK_FALSE(check_writable(folder / row.name));
    }
    CHECK(check_writable(folder / "a.webp", {16'383, 1}));
    CHECK_FALSE(check_writable(folder / "a.webp", {16'384, 1}));
    CHECK_FALSE(check_writable(folder / "a.jpe", {1, 65'501}));
    CHECK(folder.file_count() == 0);
}

TEST_CASE("png says nothing about colour nor time") {
    const Folder folder;
    const LevelsPicture picture = all_levels();
    REQUIRE(write_levels(folder / "a.png", {picture.extent, picture.rgb}));
    const std::string bytes = bytes_of(folder / "a.png");
    for (const char* chunk : {"gAMA", "cHRM", "sRGB", "iCCP", "tIME", "tEXt"}) {
        CAPTURE(chunk);
        CHECK(bytes.find(chunk) == std::string::npos);
    }
}

TEST_CASE("exr holds every float to the bit with its place and its attributes") {
    const Folder folder;
    const PixelRect window{10, 20, 7, 5};
    const auto rgb = odd_floats(3 * window.pixel_count());
    const std::vector<PictureAttribute> attributes = {
        {"fraja:scene", "00ff"}, {"fraja:settings", "-r 100x80 -a 2"}, {"fraja:version", "0.1.0"}};
    REQUIRE(write_picture(folder / "a.exr", film_of({100, 80}, window, rgb), attributes));
    const auto read = read_radiance(folder / "a.exr");
    REQUIRE(read);
    CHECK(read->extent == Extent{100, 80});
    CHECK(read->window == window);
    CHECK(same_bits(read->rgb, rgb));
    for (const PictureAttribute& attribute : attributes) {
        CAPTURE(attribute.name);
        CHECK(std::ranges::count(read->attributes, attribute) == 1);
    }
}

TEST_CASE("exr holds each pixel's samples and error to the bit, where the film keeps them") {
    const Folder folder;
    const PixelRect window{10, 20, 7, 5};
    const Film film = film_with_estimates({100, 80}, window);
    const auto copy = [](std::span<const float> floats) {
        return std::vector(floats.begin(), floats.end());
    };
    REQUIRE(write_picture(folder / "a.exr", film));
    const auto read = read_radiance(folder / "a.exr");
    REQUIRE(read);
    CHECK(read->extent == Extent{100, 80});
    CHECK(read->window == window);
    CHECK(same_bits(read->rgb, copy(film.pixels())));
    REQUIRE(read->channels.size() == 2);
    CHECK(read->channels[0].name == "error");
    CHECK(same_bits(read->channels[0].values, copy(film.error())));
    CHECK(read->channels[1].name == "samples");
    CHECK(same_bits(read->channels[1].values, copy(film.samples())));

    REQUIRE(write_picture(folder / "b.exr", film_of({100, 80}, window, copy(film.pixels()))));
    const auto colours = read_radiance(folder / "b.exr");
    REQUIRE(colours);
    CHECK(same_bits(colours->rgb, copy(film.pixels())));
    CHECK(colours->channels.empty());
}

TEST_CASE("exr holds layers to the bit, also beside samples and errors, also beside half colours") {
    const Folder folder;
    const PixelRect window{1, 2, 5, 3};
    const std::size_t n = window.pixel_count();
    for (const bool half : {false, true})
        for (const bool estimates : {false, true}) {
            CAPTURE(half);
            CAPTURE(estimates);
            Film film({10, 10}, window, {.estimates = estimates, .layers = true});
            std::vector<float> rgb(3 * n, 0.25f);
            rgb[1] = 1.0f / 3;
            film.place({.rect = window,
                        .rgb = rgb,
                        .samples = std::vector<float>(n, 7),
                        .error = std::vector<float>(n, 1.0f / 3),
                        .layers = odd_floats(layer_names.size() * n)});
            REQUIRE(write_picture(folder / "a.exr", film, {}, {.half = half}));
            const auto read = read_radiance(folder / "a.exr");
            REQUIRE(read);
            CHECK(read->rgb[0] == 0.25f);
            CHECK((read->rgb[1] == rgb[1]) == !half);
            CHECK(std::abs(read->rgb[1] - rgb[1]) < 2e-4f);
            CHECK(read->channels.size() == layer_names.size() + (estimates ? 2 : 0));
            for (const Channel& channel : read->channels) {
                CAPTURE(channel.name);
                const auto layer = std::ranges::find(layer_names, channel.name);
                if (layer == layer_names.end()) {
                    CHECK(channel.values[0] == (channel.name == "samples" ? 7 : 1.0f / 3));
                    continue;
                }
                const auto which = static_cast<std::size_t>(layer - layer_names.begin());
                const auto want = film.layers().subspan(which * n, n);
                CHECK(same_bits(channel.values, std::vector(want.begin(), want.end())));
            }
        }
}

TEST_CASE("half colours take half the room") {
    const Folder folder;
    Rng rng(1);
    Film film({64, 64});
    std::vector<float> rgb(3 * 64 * 64);
    for (float& c : rgb)
        c = static_cast<float>(rng.unit()); // which no compression makes smaller
    film.place({{0, 0, 64, 64}, rgb});
    REQUIRE(write_picture(folder / "float.exr", film));
    REQUIRE(write_picture(folder / "half.exr", film, {}, {.half = true}));
    CHECK(fs::file_size(folder / "half.exr") <
          0.6 * static_cast<double>(fs::file_size(folder / "float.exr")));
}

TEST_CASE("8-bit formats have no room for samples and errors: they hold the same colours") {
    const Folder folder;
    const PixelRect window{3, 4, 6, 5};
    const Film film = film_with_estimates({10, 10}, window);
    const Film colours =
        film_of({10, 10}, window, std::vector(film.pixels().begin(), film.pixels().end()));
    for (const char* ext : {".png", ".tif", ".jpg", ".bmp", ".ppm", ".tga"}) {
        CAPTURE(ext);
        REQUIRE(write_picture(folder / (std::string("a") + ext), film));
        REQUIRE(write_picture(folder / (std::string("b") + ext), colours));
        CHECK(bytes_of(folder / (std::string("a") + ext)) ==
              bytes_of(folder / (std::string("b") + ext)));
    }
}

TEST_CASE("same pixels make the same bytes") {
    const Folder folder;
    const LevelsPicture picture = all_levels();
    const Film film = film_of({64, 12}, {0, 0, 64, 12}, odd_floats(3 * 64 * 12));
    const std::vector<PictureAttribute> attributes = {{"fraja:scene", "00ff"}};
    const auto write = [&](const fs::path& path) {
        return path.extension() == ".exr" ? write_picture(path, film, attributes)
                                          : write_levels(path, {picture.extent, picture.rgb});
    };
    for (const char* ext : {".png", ".exr", ".tif", ".jpg", ".bmp", ".ppm", ".tga"}) {
        CAPTURE(ext);
        REQUIRE(write(folder / (std::string("a") + ext)));
        REQUIRE(write(folder / (std::string("other name") + ext)));
        const std::string first = bytes_of(folder / (std::string("a") + ext));
        CHECK(first == bytes_of(folder / (std::string("other name") + ext)));
    }
    const Film estimates = film_with_estimates({64, 12}, {0, 0, 64, 12});
    REQUIRE(write_picture(folder / "c.exr", estimates, attributes));
    REQUIRE(write_picture(folder / "d.exr", estimates, attributes));
    CHECK(bytes_of(folder / "c.exr") == bytes_of(folder / "d.exr"));
}

TEST_CASE("no file tells when it was written") { // the bytes above were written in one second
    const Folder folder;
    const Film film({8, 8});
    const std::time_t now = std::time(nullptr);
    std::array<char, 8> year{};
    REQUIRE(std::strftime(year.data(), year.size(), "%Y:", std::localtime(&now)) > 0);
    for (const char* name : {"a.png", "a.exr", "a.tif", "a.jpg", "a.bmp", "a.ppm", "a.tga",
                             "a.webp", "a.dpx", "a.hdr"}) {
        CAPTURE(name);
        REQUIRE(write_picture(folder / name, film));
        CHECK(bytes_of(folder / name).find(year.data()) == std::string::npos);
    }
}

TEST_CASE("write_picture quantises for 8-bit formats and leaves out the attributes") {
    const Folder folder;
    const PixelRect region{3, 4, 2, 1};
    const float one = 1.0f, nan = std::numeric_limits<float>::quiet_NaN();
    const Film film = film_of({10, 10}, region, {0.0f, 0.5f, one, 2.0f, -1.0f, nan});
    const std::vector<PictureAttribute> attributes = {{"fraja:scene", "00ff"}};
    for (const char* name : {"a.png", "a.tif", "a.ppm", "a.bmp", "a.tga"}) {
        CAPTURE(name);
        REQUIRE(write_picture(folder / name, film, attributes));
        CHECK(read_levels(folder / name).value() ==
              LevelsPicture{{2, 1}, {0, 128, 255, 255, 0, 0}});
        CHECK(bytes_of(folder / name).find("00ff") == std::string::npos);
    }
}

TEST_CASE("write_picture encodes by the transfer that is asked for") {
    const Folder folder;
    const Film film = film_of({1, 1}, {0, 0, 1, 1}, {0.18f, 0.5f, 1.0f});
    REQUIRE(write_picture(folder / "a.png", film, {}, {.transfer = Transfer::srgb}));
    CHECK(read_levels(folder / "a.png").value().rgb == std::vector<std::uint8_t>{118, 188, 255});
    REQUIRE(write_picture(folder / "a.png", film, {}, {.transfer = Transfer::linear}));
    CHECK(read_levels(folder / "a.png").value().rgb == std::vector<std::uint8_t>{46, 128, 255});
}

TEST_CASE("levels are not written where floats are expected") {
    const Folder folder;
    const LevelsPicture picture = all_levels();
    const auto written = write_levels(folder / "a.exr", {picture.extent, picture.rgb});
    REQUIRE_FALSE(written);
    CHECK(written.error().code == ErrorCode::invalid_argument);
    CHECK(folder.file_count() == 0);
}

TEST_CASE("pixel_kind knows formats by extension and guesses what was meant") {
    CHECK(pixel_kind("x/a.b.PnG").value() == PixelKind::levels8);
    CHECK(pixel_kind("a.exr").value() == PixelKind::radiance_and_more);
    struct Row {
        const char *path, *want;
    };
    for (const Row& row :
         {Row{"cone.pgn", "cone.pgn: unknown extension (did you mean '.png'?)"},
          Row{"cone.docx", "cone.docx: unknown extension; use one of .png .exr"},
          Row{"cone", "cone: the extension names the format; use one of .png .exr"},
          Row{"cone.", "cone.: the extension names the format"},
          Row{".png", ".png: the extension names the format"}, Row{"", ": the extension names"}}) {
        CAPTURE(row.path);
        const auto kind = pixel_kind(row.path);
        REQUIRE_FALSE(kind);
        CHECK(kind.error().code == ErrorCode::invalid_argument);
        CHECK(kind.error().message.starts_with(row.want));
    }
}

TEST_CASE("check_writable finds what would spoil the end of a render and leaves no trace") {
    const Folder folder;
    fs::create_directory(folder / "folder.png");
    put(folder / "old.png", "old");
    struct Row {
        const char *name, *want; // nullptr: writable
    };
    for (const Row& row :
         {Row{"new.png", nullptr}, Row{"old.png", nullptr},
          Row{"folder.png", "this is a directory"}, Row{"no/such/a.png", "there is no directory"},
          Row{"old.png/a.png", "there is no directory"}, Row{"a.xyz", "unknown extension"}}) {
        CAPTURE(row.name);
        const auto writable = check_writable(folder / row.name);
        CHECK(writable.has_value() == (row.want == nullptr));
        if (!writable && row.want)
            CHECK(writable.error().message.find(row.want) != std::string::npos);
    }
    CHECK(check_writable(folder / (std::string(400, 'x') + ".png")).error().code == ErrorCode::io);
    CHECK(check_writable("/proc/a.png").error().code == ErrorCode::io); // root may not either
    CHECK(bytes_of(folder / "old.png") == "old");
    CHECK(folder.file_count() == 2);
}

TEST_CASE("check_writable asks for permission") {
    if (::geteuid() == 0)
        return; // nobody refuses root
    const Folder folder;
    put(folder / "old.png", "old");
    fs::permissions(folder / "old.png", fs::perms::owner_read);
    CHECK_FALSE(check_writable(folder / "old.png"));
    fs::permissions(folder.path, fs::perms::owner_read | fs::perms::owner_exec);
    CHECK_FALSE(check_writable(folder / "new.png"));
    fs::permissions(folder.path, fs::perms::owner_all);
}

TEST_CASE("a relative path needs no folder") {
    const Folder folder;
    const fs::path before = fs::current_path();
    fs::current_path(folder.path);
    const LevelsPicture picture = all_levels();
    const auto writable = check_writable("a.png");
    const auto written = write_levels("a.png", {picture.extent, picture.rgb});
    fs::current_path(before);
    CHECK(writable);
    CHECK(written);
    CHECK(folder.file_count() == 1);
}

TEST_CASE("a failing write leaves the old picture and nothing else") {
    const Folder folder;
    // Noise, so that no format makes it small.
    LevelsPicture picture{{300, 300}, {}};
    std::uint32_t noise = 1;
    for (std::uint32_t i = 0; i < 3 * 300 * 300; ++i)
        picture.rgb.push_back(
            static_cast<std::uint8_t>((noise = noise * 1664525 + 1013904223) >> 24));
    std::vector<float> rgb;
    for (const std::uint8_t level : picture.rgb)
        rgb.push_back(std::sqrt(static_cast<float>(level)));
    const Film film = film_of({300, 300}, {0, 0, 300, 300}, rgb);
    const auto write = [&](const fs::path& path) {
        return pixel_kind(path).value() != PixelKind::levels8
                   ? write_picture(path, film)
                   : write_levels(path, {picture.extent, picture.rgb});
    };
    for (const char* ext :
         {".png", ".exr", ".tif", ".jpg", ".bmp", ".ppm", ".tga", ".hdr", ".webp", ".dpx"}) {
        CAPTURE(ext);
        const fs::path path = folder / (std::string("a") + ext);
        put(path, "the old one");
        {
            const FullDisk full(20'000);
            const auto written = write(path);
            REQUIRE_FALSE(written);
            CAPTURE(written.error().message);
            CHECK(written.error().code == ErrorCode::io);
            CHECK(written.error().message.starts_with(path.string() + ": "));
            CHECK(written.error().message.find(".fraja-") == std::string::npos);
        }
        CHECK(bytes_of(path) == "the old one");
        REQUIRE(write(path));
        CHECK(bytes_of(path) != "the old one");
        fs::remove(path);
        CHECK(folder.file_count() == 0);
    }
}

TEST_CASE("a picture too wide for its format is an error") {
    const Folder folder;
    const std::vector<std::uint8_t> line(3 * 70'000, 7);
    for (const char* name : {"a.jpg", "a.jpeg", "a.tga"}) {
        CAPTURE(name);
        CHECK_FALSE(check_writable(folder / name, {70'000, 1}));
        CHECK_FALSE(write_levels(folder / name, {{70'000, 1}, line}));
    }
    CHECK(folder.file_count() == 0);
    CHECK(write_levels(folder / "a.png", {{70'000, 1}, line}));
}

TEST_CASE("a link is followed, also to a picture that does not exist yet") {
    const Folder folder;
    fs::create_directory(folder / "there");
    fs::create_symlink("there/real.png", folder / "link.png");
    const LevelsPicture picture = all_levels();
    for (int i = 0; i < 2; ++i) {
        REQUIRE(write_levels(folder / "link.png", {picture.extent, picture.rgb}));
        CHECK(fs::is_symlink(folder / "link.png"));
        CHECK(fs::is_regular_file(folder / "there/real.png"));
    }
}

TEST_CASE("what is no picture is refused with its name") {
    const Folder folder;
    put(folder / "text.png", "this is no picture");
    put(folder / "empty.exr", "");
    for (const char* name : {"text.png", "missing.png", "empty.exr"}) {
        CAPTURE(name);
        const auto levels = read_levels(folder / name);
        REQUIRE_FALSE(levels);
        CHECK(levels.error().code == ErrorCode::io);
        CHECK(levels.error().message.starts_with((folder / name).string() + ": "));
        CHECK_FALSE(read_radiance(folder / name));
    }
    const LevelsPicture picture = all_levels();
    REQUIRE(write_levels(folder / "a.png", {picture.extent, picture.rgb}));
    CHECK_FALSE(read_radiance(folder / "a.png"));
}
