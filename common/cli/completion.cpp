#include "common/cli/completion.hpp"

#include "common/base/text.hpp"
#include "common/cli/option_card.hpp"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <utility>

namespace fraja::cli {
namespace {

/// Where the words before the last one have led.
class Place {
public:
    explicit Place(const CLI::App& app) : app_(app) { enter(app); }

    void pass(const std::string& word) {
        if (awaited_)
            awaited_.reset();
        else if (only_arguments_ || word.empty() || word == "-" || word[0] != '-')
            pass_argument(word);
        else if (word == "--")
            only_arguments_ = true;
        else
            awaited_ = awaited_by(word);
    }

    [[nodiscard]] bool takes_options() const { return !only_arguments_; }
    [[nodiscard]] const std::vector<OptionCard>& cards() const { return cards_; }
    /// The option whose value comes next.
    [[nodiscard]] const std::optional<OptionCard>& awaited() const { return awaited_; }
    [[nodiscard]] const OptionCard* argument() const {
        const auto is_argument = [](const OptionCard& card) { return card.names.empty(); };
        std::size_t left = passed_;
        for (const OptionCard& card : cards_)
            if (is_argument(card) && left-- == 0)
                return &card;
        return nullptr;
    }
    [[nodiscard]] std::vector<Candidate> commands() const {
        std::vector<Candidate> all;
        if (command_)
            return all;
        for (const CLI::App* sub : app_.get_subcommands([](const CLI::App*) { return true; }))
            all.push_back({sub->get_name(), sub->get_description()});
        return all;
    }
    [[nodiscard]] const OptionCard* option(std::string_view name) const {
        const auto found = std::ranges::find_if(
            cards_, [&](const OptionCard& card) { return card.has_name(name); });
        return found == cards_.end() ? nullptr : &*found;
    }

private:
    void enter(const CLI::App& app) {
        for (OptionCard& card : cards_of(app))
            if (card.names.empty() || !option(card.name()))
                cards_.push_back(std::move(card));
    }
    void pass_argument(const std::string& word) {
        const auto named =
            app_.get_subcommands([&](const CLI::App* sub) { return sub->get_name() == word; });
        if (command_ || named.empty()) {
            ++passed_;
            return;
        }
        command_ = named.front();
        enter(*command_);
    }
    [[nodiscard]] std::optional<OptionCard> awaited_by(const std::string& word) const {
        const OptionCard* card = option(word); // -a4 and --aa=4 have theirs
        return card && card->takes_value() ? std::optional(*card) : std::nullopt;
    }

    const CLI::App& app_;
    const CLI::App* command_ = nullptr;
    std::vector<OptionCard> cards_; ///< of the program, and of the command that was named
    std::optional<OptionCard> awaited_;
    std::size_t passed_ = 0; ///< arguments without a name
    bool only_arguments_ = false;
};

std::string lines_of(const std::vector<Candidate>& candidates, std::string_view begun,
                     const std::string& before = {}) {
    std::string lines;
    for (const Candidate& candidate : candidates)
        if (candidate.word.starts_with(begun))
            lines += before + printable(candidate.word) + '\t' + printable(candidate.what) + '\n';
    return lines;
}

class Completer {
public:
    Completer(CLI::App& app, std::vector<std::string> words, const NameSource& names)
        : app_(app), names_(names), place_(app) {
        if (!words.empty()) {
            begun_ = std::move(words.back());
            words.pop_back();
        }
        before_ = std::move(words);
        for (const std::string& word : before_)
            place_.pass(word);
    }

    std::string lines() {
        if (place_.awaited())
            return values(*place_.awaited(), begun_);
        if (place_.takes_options() && begun_.starts_with("-"))
            return options();
        if (const auto commands = place_.commands(); !commands.empty())
            return lines_of(commands, begun_);
        const OptionCard* const argument = place_.argument();
        return argument ? values(*argument, begun_) : "";
    }

private:
    std::string options() {
        const auto equals = begun_.find('=');
        if (equals != std::string::npos) {
            const OptionCard* const card = place_.option(begun_.substr(0, equals));
            return card && card->takes_value()
                       ? values(*card, begun_.substr(equals + 1), begun_.substr(0, equals + 1))
                       : "";
        }
        std::vector<Candidate> all;
        for (const OptionCard& card : place_.cards())
            if (!card.names.empty())
                all.push_back({card.name(), card.text});
        return lines_of(all, begun_);
    }

    std::string values(const OptionCard& card, const std::string& begun,
                       const std::string& before = {}) {
        std::vector<Candidate> all;
        for (const std::string& choice : card.choices)
            all.push_back({choice, {}});
        if (!all.empty())
            return lines_of(all, begun, before);
        if (card.value == "FILE")
            return ":files\n";
        if (card.value == "DIR")
            return ":directories\n";
        if (const auto dot = card.value.rfind('.'); dot != std::string::npos)
            return ":files " + card.value.substr(dot + 1) + "\n";
        if (!names_)
            return {};
        read_what_stands();
        return lines_of(names_(card.value, begun), begun, before);
    }

    /// Which broker, above all.
    void read_what_stands() {
        std::ranges::reverse(before_);
        try {
            app_.parse(std::move(before_));
        } catch (const CLI::ParseError&) { // it is not all there yet: what is has been read
        }
    }

    CLI::App& app_;
    const NameSource& names_;
    std::vector<std::string> before_;
    std::string begun_;
    Place place_;
};

} // namespace

std::string completions(CLI::App& app, std::vector<std::string> words, const NameSource& names) {
    return Completer(app, std::move(words), names).lines();
}

} // namespace fraja::cli
