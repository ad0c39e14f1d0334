// TAB in real shells.
#include "tests/e2e/farm.hpp"

#include <cstdlib>
#include <fstream>

using namespace fraja;
using namespace fraja::e2e;

namespace {

bool is_installed(const std::string& shell) {
    const auto found = run({{"sh", "-c", "command -v " + shell}}, patience);
    const bool there = found.has_value() && found->exit == 0;
    if (!there)
        MESSAGE(shell << " is not installed (tools/packages ci): its completion is NOT tested");
    return there;
}

Words with_programs() {
    return {"PATH=" FRAJA_BIN_DIR ":" + std::string(std::getenv("PATH"))};
}

/// The script of fraja-ctl completion, in a folder that has a scene and a folder.
class Shell {
public:
    explicit Shell(const std::string& name) : script_(scratch_.file(name)) {
        const auto printed = run({{program("fraja-ctl"), "completion", name}}, patience);
        REQUIRE(printed.has_value());
        REQUIRE(printed->exit == 0);
        std::ofstream(script_) << printed->out;
        std::ofstream(scratch_.file("marble.raj")) << "";
        std::ofstream(scratch_.file("marble.txt")) << "";
        fs::create_directory(scratch_.file("marbles"));
    }

    /// Everything that the shell says of `text`, which has the script as $SCRIPT.
    std::string says(Words shell, const std::string& text) {
        auto result = run({with(std::move(shell), {"cd " + scratch_.file("") + "; " + text}),
                           with({"SCRIPT=" + script_}, with_programs())},
                          patience);
        REQUIRE(result.has_value());
        CHECK(result->exit == 0);
        return result->out + result->err;
    }

private:
    const Scratch scratch_;
    std::string script_;
};

/// What is typed, and what must be offered.
struct Row {
    std::string typed, offers;
};

} // namespace

TEST_CASE("bash completes the programs by the script that fraja-ctl prints") {
    Shell bash("bash");
    const std::string tab = R"(
. "$SCRIPT"
tab() {
    COMP_LINE=$1 COMP_POINT=${#1}
    compopt() { :; } # is for the line editor
    local function=$(complete -p "${1%% *}"); function=${function#*-F }
    "${function%% *}" "${1%% *}"
    printf '%s ' "${COMPREPLY[@]}"
}
)";
    for (const Row& row : {
             Row{"fraja-submit --tim", "--time-limit --timeout "},
             Row{"fraja-submit --kernel=r", "reference "},
             Row{"fraja-submit --kernel r", "reference "},
             Row{"fraja-submit ma", "marbles marble.raj "},
             Row{"fraja-broker --state ma", "marbles "},
             Row{"fraja-worker --log-level e", "error "},
             Row{"fraja-watch -o marble.t", "marble.txt "},
             Row{"fraja-ctl wo", "workers "},
         }) {
        CAPTURE(row.typed);
        CHECK(bash.says({"bash", "-c"}, tab + "tab '" + row.typed + "'") == row.offers);
    }
}

TEST_CASE("zsh completes the programs at a terminal") {
    if (!is_installed("zsh"))
        return;
    Shell zsh("zsh");
    std::string text = R"(
zmodload zsh/zpty
zpty z zsh -f -i
zpty -w z 'PROMPT=; autoload -U compinit; compinit -u -D; . $SCRIPT; print REA""DY'
zpty -r -m z line '*READY*'
tab() {
    zpty -w -n z "$1"$'\t'
    zpty -r -m z line "*$2*"
    zpty -w -n z $'\C-u'
}
)";
    for (const Row& row : {
             Row{"fraja-submit --overw", "fraja-submit --overwrite"},
             Row{"fraja-submit --kernel=r", "--kernel=reference"},
             Row{"fraja-submit --kernel r", "--kernel reference"},
             Row{"fraja-submit marble.", "fraja-submit marble.raj"},
             Row{"fraja-broker --state ma", "--state marbles"},
             Row{"fraja-watch --output=marble.t", "--output=marble.txt"},
             Row{"fraja-ctl wo", "fraja-ctl workers"},
         })
        text += "tab '" + row.typed + "' '" + row.offers + "'\n";
    CHECK(contains(zsh.says({"zsh", "-f", "-c"}, text + "print all were offered"),
                   "all were offered"));
}

TEST_CASE("fish completes the programs") {
    if (!is_installed("fish"))
        return;
    Shell fish("fish");
    for (const Row& row : {
             Row{"fraja-submit --overw", "--overwrite"},
             Row{"fraja-submit --kernel=r", "--kernel=reference"},
             Row{"fraja-submit --kernel r", "reference"},
             Row{"fraja-submit marble.r", "marble.raj"},
             Row{"fraja-broker --state marb", "marbles/"},
             Row{"fraja-ctl wo", "workers"},
         }) {
        CAPTURE(row.typed);
        const std::string said = fish.says({"fish", "--no-config", "-c"},
                                           "source $SCRIPT; complete -C '" + row.typed + "'");
        CHECK(said.substr(0, said.find_first_of("\t\n")) == row.offers);
    }
}

TEST_CASE(
    "jobs and workers are offered by the broker that is named, and none where there is none") {
    Farm farm;
    farm.add_worker("ada");
    const std::string job = farm.detach({scene("cone"), "-r", "8x6"});
    const auto offered = [&](const std::string& broker, Words words) {
        auto result = run({with({program(words[0]), "--complete", "-b", broker},
                                {words.begin() + 1, words.end()})},
                          patience);
        REQUIRE(result.has_value());
        CHECK(result->exit == 0);
        CHECK(result->err.empty());
        return result->out;
    };
    // A key does not wait long: a busy machine may need it pressed again.
    const auto pressed_until_offered = [&](const Words& words, const std::string& want) {
        const auto give_up = std::chrono::steady_clock::now() + patience;
        std::string lines;
        while (lines.empty() && std::chrono::steady_clock::now() < give_up)
            lines = offered(farm.endpoint(), words);
        CAPTURE(lines);
        CHECK(lines.starts_with(want));
    };
    pressed_until_offered({"fraja-watch", ""}, "cone\tcone #1 is ");
    pressed_until_offered({"fraja-ctl", "show", job.substr(0, 5)}, job);
    pressed_until_offered({"fraja-ctl", "drain", "a"}, "ada\t");
    CHECK(offered(farm.endpoint(), {"fraja-ctl", "drain", "z"}).empty());
    CHECK(offered("tcp://127.0.0.1:1", {"fraja-watch", ""}).empty());
}
