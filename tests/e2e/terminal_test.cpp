#include "client/preview/preview.hpp"
#include "client/preview/sixel.hpp"
#include "tests/e2e/farm.hpp"
#include "tests/support/terminal.hpp"

using namespace fraja;
using namespace fraja::e2e;

namespace {

constexpr std::string_view other_screen = "\x1b[?1049h", first_screen = "\x1b[?1049l";
constexpr std::string_view show_cursor = "\x1b[?25h";

Process start_at(const Terminal& terminal, const Words& argv, Words env = {}) {
    auto process =
        Process::start({terminal.command(argv),
                        with({"TERM=xterm-256color", "COLORTERM=truecolor",
                              "TMUX=", "STY=", "KITTY_WINDOW_ID=", "TERM_PROGRAM=", "NO_COLOR="},
                             env)});
    REQUIRE(process.has_value());
    return *std::move(process);
}

/// As it is drawn in half blocks in a window of that size, below whose picture are two rows.
std::string blocks_of(const std::string& file, client::Window window) {
    const auto levels = read_levels(file);
    REQUIRE(levels.has_value());
    Film film(levels->extent);
    Tile tile{.rect = film.region(), .rgb = {}};
    for (const std::uint8_t level : levels->rgb)
        tile.rgb.push_back(static_cast<float>(level) / 255);
    film.place(tile);
    window.rows -= 2;
    const auto preview =
        client::make_preview(film, window, client::PreviewMode::blocks, client::ColorDepth::direct);
    REQUIRE(preview.has_value());
    return preview->bytes;
}

} // namespace

TEST_CASE("the farm's table fills the terminal, follows its size, and gives it back as it was") {
    Farm farm;
    farm.add_worker("ada");
    struct Row {
        const char* keys;
        int exit;
    };
    for (const Row& row : {Row{"q", 0}, Row{"\x03", 130}}) {
        Terminal terminal({100, 30});
        Process watcher = start_at(terminal, {program("fraja-watch"), "-b", farm.endpoint()});
        REQUIRE(terminal.wait_for(other_screen, patience));
        REQUIRE(terminal.wait_for("WORKER  THREADS", patience));
        REQUIRE(terminal.wait_for("ada", patience));
        CHECK_FALSE(terminal.is_sane()); // keys are read one by one
        terminal.resize({30, 5});
        REQUIRE(terminal.wait_for("\x1b[H0 jobs, 0 not over; 1 worker, \r\n", patience)); // cut
        REQUIRE(terminal.wait_for("\x1b[J", patience));
        terminal.type(row.keys);
        REQUIRE(terminal.wait_for_end(patience));
        CHECK(watcher.wait_for_exit(patience) == row.exit);
        CHECK(terminal.is_sane());
        CHECK(terminal.text().rfind(show_cursor) > terminal.text().rfind("\x1b[?25l"));
        CHECK(terminal.text().ends_with(first_screen));
    }
}

TEST_CASE("a job on a terminal is a picture above a bar and no line of tiles") {
    const Scratch scratch;
    Farm farm;
    const Words picture = {scene("cone"), "-r", "32x24"};
    (void)local_picture(scratch, picture);
    const std::string job = farm.detach(picture);
    Terminal terminal({60, 20});
    Process watcher = start_at(terminal, {program("fraja-watch"), "-b", farm.endpoint(), job});
    REQUIRE(terminal.wait_for("waiting for workers", patience));
    farm.add_worker("ada");
    REQUIRE(terminal.wait_for_end(patience));
    CHECK(watcher.wait_for_exit(patience) == 0);
    INFO(terminal.text());
    CHECK(contains(terminal.text(),
                   blocks_of(scratch.file("local.png"), {.columns = 60, .rows = 20})));
    CHECK(contains(terminal.text(), "cone #1  100%"));
    CHECK_FALSE(contains(terminal.text(), " rays\n"));
    CHECK(terminal.is_sane());
}

TEST_CASE("a job that is watched on a terminal is left as the table is, and goes on") {
    Farm farm;
    const std::string job = farm.detach({scene("cone"), "-r", "32x24"});
    struct Row {
        const char* keys;
        int exit;
        Words options;
    };
    for (const Row& row : {Row{"xq", 0, {}}, Row{"\x03", 130, {}}, Row{"q", 0, {"--json"}},
                           Row{"Q", 0, {"--preview", "none"}}}) {
        CAPTURE(row.keys);
        Terminal terminal({60, 20});
        Process watcher = start_at(
            terminal, with({program("fraja-watch"), "-b", farm.endpoint(), job}, row.options));
        REQUIRE(terminal.wait_for("queued", patience));
        CHECK_FALSE(terminal.is_sane()); // keys are read one by one
        terminal.type(row.keys);
        REQUIRE(terminal.wait_for_end(patience));
        CHECK(watcher.wait_for_exit(patience) == row.exit);
        CHECK(terminal.is_sane());
    }
    const auto shown = run({{program("fraja-ctl"), "-b", farm.endpoint(), "show", job}}, patience);
    REQUIRE(shown.has_value());
    CHECK(contains(shown->out, "state     queued"));
}

TEST_CASE("a terminal that says so gets sixels") {
    if (!client::check_sixel()) // only where libchafa is installed
        return;
    Farm farm;
    farm.add_worker("ada");
    const std::string job = farm.detach({scene("cone"), "-r", "32x24"});
    Terminal terminal({60, 20});
    Process watcher = start_at(terminal, {program("fraja-watch"), "-b", farm.endpoint(), job});
    REQUIRE(terminal.wait_for("\x1b[c", patience));
    terminal.type("\x1b[?62;4;22c");
    REQUIRE(terminal.wait_for_end(patience));
    CHECK(watcher.wait_for_exit(patience) == 0);
    CHECK(contains(terminal.text(), "\x1bP"));
    CHECK(terminal.is_sane());
}

TEST_CASE("a preview is only shown where it is wanted and can be") {
    const Scratch scratch;
    const auto draw = [&](const Words& options, const Words& env) {
        Terminal terminal({60, 20});
        Process submit = start_at(terminal,
                                  with({program("fraja-submit"), "--local", scene("cone"), "-r",
                                        "32x24", "-o", scratch.file("now.png")},
                                       options),
                                  env);
        REQUIRE(terminal.wait_for_end(patience));
        CHECK(submit.wait_for_exit(patience) == 0);
        return terminal.text();
    };
    CHECK_FALSE(contains(draw({}, {}), "\u2580"));
    CHECK(contains(draw({"--preview=blocks"}, {}),
                   blocks_of(scratch.file("now.png"), {.columns = 60, .rows = 20})));
    CHECK(contains(draw({"--preview=kitty"}, {}), "\x1b_Ga=T,"));
    CHECK(contains(draw({"--preview"}, {"TERM=xterm-kitty"}), "\x1b_Ga=T,"));
    CHECK_FALSE(contains(draw({"--preview"}, {"NO_COLOR=1"}), "\u2580"));
    const RunResult piped = submit({"--local", scene("cone"), "-r", "32x24", "-o",
                                    scratch.file("now.png"), "--preview=blocks"});
    CHECK(piped.exit == 0);
    CHECK_FALSE(contains(piped.err, "\x1b"));
}
