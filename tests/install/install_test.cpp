// The installed tree, with its manual pages and packages.
#include "tests/e2e/farm.hpp"

#include <fstream>
#include <regex>

using namespace fraja;
using namespace fraja::e2e;

namespace {

const Words programs = {"fraja-broker", "fraja-worker", "fraja-submit", "fraja-watch", "fraja-ctl"};

RunResult done(Words argv) {
    auto result = run({std::move(argv)}, patience);
    REQUIRE(result.has_value());
    INFO(result->err);
    REQUIRE(result->exit == 0);
    return *std::move(result);
}

bool is_installed(const std::string& tool) {
    const auto found = run({{"sh", "-c", "command -v " + tool}}, patience);
    return found.has_value() && found->exit == 0;
}

void install(const std::string& prefix, const Words& options = {}) {
    done(with({FRAJA_CMAKE, "--install", FRAJA_BUILD_DIR, "--prefix", prefix}, options));
}

} // namespace

TEST_CASE("what is installed draws, wherever it is moved to") {
    const Scratch scratch;
    install(scratch.file("first"));
    fs::rename(scratch.file("first"), scratch.file("moved"));
    const fs::path moved = scratch.file("moved");
    done({(moved / "bin/fraja-submit").string(), "--local", "-r", "40x30",
          (moved / "share/fraja/scenes/cone.raj").string(), "-o", scratch.file("x.png")});
    CHECK((bytes_of(scratch.file("x.png")) ==
           local_picture(scratch, {scene("cone"), "-r", "40x30"})));
    const fs::path link = moved / "fraja"; // as in /usr/local/bin
    fs::create_symlink(moved / "bin/fraja-submit", link);
    done({link.string(), "--local", "-r", "8x6", scene("cone"), "-o", scratch.file("y.png")});
}

TEST_CASE("every program is installed with its manual page and its completions") {
    const Scratch scratch;
    install(scratch.file("tree"));
    const fs::path tree = scratch.file("tree");
    for (const std::string& name : programs) {
        CAPTURE(name);
        CHECK(done({(tree / "bin" / name).string(), "--version"}).out.starts_with(name));
        CHECK(fs::file_size(tree / "share/bash-completion/completions" / name) > 0);
        CHECK(fs::file_size(tree / "share/zsh/vendor-completions" / ("_" + name)) > 0);
        CHECK(fs::file_size(tree / "share/fish/vendor_completions.d" / (name + ".fish")) > 0);
        if (is_installed("scdoc"))
            CHECK(fs::exists(tree / "share/man/man1" / (name + ".1.gz")));
    }
    CHECK(fs::exists(tree / "lib/fraja/picture_codec.so"));
    CHECK(fs::exists(tree / "share/fraja/scenes/travels/cone.raj"));
    CHECK_FALSE(fs::exists(tree / "share/fraja/scenes/invalid"));
    if (is_installed("scdoc"))
        CHECK(fs::exists(tree / "share/man/man7/fraja.7.gz"));
}

TEST_CASE("a machine that renders is not sent what writes pictures") {
    const Scratch scratch;
    install(scratch.file("worker"), {"--component", "worker"});
    const fs::path tree = scratch.file("worker");
    CHECK(fs::exists(tree / "bin/fraja-worker"));
    CHECK_FALSE(fs::exists(tree / "bin/fraja-submit"));
    CHECK_FALSE(fs::exists(tree / "lib/fraja"));
    CHECK_FALSE(fs::exists(tree / "share/fraja"));
}

TEST_CASE("a manual page has every option that --help has, and groff nothing to say of it") {
    if (!is_installed("scdoc") || !is_installed("groff")) {
        MESSAGE("scdoc or groff is not installed: the manual pages are NOT tested");
        return;
    }
    const std::regex long_option("(?:^|\n) +(?:-\\w,)?(--[a-z-]+)");
    for (const std::string& name : programs) {
        CAPTURE(name);
        const std::string page = FRAJA_BUILD_DIR "/man/" + name + ".1.gz";
        const RunResult text =
            done({"sh", "-c", "zcat " + page + " | groff -t -ww -man -Tascii -P-cbou"});
        CHECK(text.err.empty());
        const std::string help = done({program(name.c_str()), "--help"}).out;
        std::size_t options = 0;
        for (std::sregex_iterator it(help.begin(), help.end(), long_option), end; it != end; ++it) {
            CAPTURE((*it)[1].str());
            CHECK(contains(text.out, (*it)[1].str()));
            ++options;
        }
        CHECK(options > 6);
    }
    const RunResult overview =
        done({"sh", "-c",
              "zcat " FRAJA_BUILD_DIR "/man/fraja.7.gz | groff -t -ww -man -Tascii -P-cbou"});
    CHECK(overview.err.empty());
    for (const char* words : {"EXIT STATUS", "FRAJA_BROKER", "143", "JOBS AND WORKERS",
                              "fraja-broker &\n", "fraja-submit scene.raj -o picture.png\n"})
        CHECK(contains(overview.out, words));
    const RunResult ctl =
        done({"sh", "-c",
              "zcat " FRAJA_BUILD_DIR "/man/fraja-ctl.1.gz | groff -t -man -Tascii -P-cbou"});
    CHECK(contains(ctl.out, " . <(fraja-ctl completion bash)\n")); // as it is typed
    CHECK(contains(ctl.out, " >> ~/.bash_completion\n"));
}

TEST_CASE("three Debian packages hold one program each, or the clients, and no pictures' library "
          "where none is written") {
    if (!is_installed("dpkg-deb") || !is_installed("dpkg-shlibdeps")) {
        MESSAGE("dpkg-dev is not installed (tools/packages package): packages are NOT tested");
        return;
    }
    const Scratch scratch;
    done({"cpack", "--config", FRAJA_BUILD_DIR "/CPackConfig.cmake", "-B", scratch.file("made")});
    struct Row {
        std::string name, holds;
        bool pictures;
    };
    for (const Row& row : {Row{"fraja-broker", "/usr/bin/fraja-broker", false},
                           Row{"fraja-worker", "/usr/bin/fraja-worker", false},
                           Row{"fraja-client", "/usr/bin/fraja-ctl", true}}) {
        CAPTURE(row.name);
        std::string package;
        for (const auto& entry : fs::directory_iterator(scratch.file("made")))
            if (entry.path().filename().string().starts_with(row.name + "_"))
                package = entry.path().string();
        REQUIRE_FALSE(package.empty());
        const std::string contents = done({"dpkg-deb", "--contents", package}).out;
        CHECK(contains(contents, "." + row.holds + "\n"));
        CHECK(contains(contents, "./usr/share/doc/" + row.name + "/copyright\n"));
        CHECK(contains(contents, "picture_codec.so") == row.pictures);
        CHECK(std::regex_search(contents, std::regex("root/root")));
        const std::string depends = done({"dpkg-deb", "--field", package, "Depends"}).out;
        CHECK(contains(depends, "libzmq5"));
        CHECK(contains(depends, "libopenimageio") == row.pictures);
    }
}
