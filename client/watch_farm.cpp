#include "client/watch_farm.hpp"

#include "client/farm_screen.hpp"
#include "client/json.hpp"
#include "client/notices.hpp"
#include "client/outlet.hpp"
#include "client/progress_report.hpp"
#include "client/screen.hpp"
#include "client/shell.hpp"
#include "client/table.hpp"
#include "common/net/clock.hpp"

#include <cstdlib>
#include <optional>
#include <string_view>
#include <unistd.h>
#include <utility>

namespace fraja::client {
namespace {

using namespace std::chrono_literals;

constexpr Duration window_look_pause = 250ms; // whether it has another size

bool fills_screen(const WatchOptions& options) {
    const char* const term = std::getenv("TERM");
    return isatty(STDOUT_FILENO) == 1 && !options.shared.json && !options.until.once && term &&
           std::string_view(term) != "dumb";
}

/// Shows the newest state: what a slow reader has had no room for is not shown later.
class FarmListener final : public Listener {
public:
    FarmListener(const WatchOptions& options, Console& console)
        : options_(options), console_(console) {
        view_.broker = options.shared.brokers.front(); // who is asked first
        if (fills_screen(options))
            screen_.emplace(outlet_);
    }

    void hear(Instant, const News& news) override {
        if (const auto* farm = std::get_if<FarmChanged>(&news)) {
            view_.farm = farm->farm;
            view_.known = changed_ = true;
        } else if (const auto* connection = std::get_if<ConnectionChanged>(&news)) {
            view_.broker = connection->broker;
            view_.connected = connection->connected;
            changed_ = true;
            if (!screen_)
                loss_.update(*connection);
        }
    }
    Instant tick(Instant now) override {
        left_ = screen_ && screen_->was_left();
        outlet_.pump();
        if (outlet_.is_empty()) {
            show();
            outlet_.pump();
        }
        return screen_ ? now + window_look_pause : Instant::never();
    }
    void wait_also(std::vector<net::Waitable>& all) const override {
        if (!outlet_.is_empty())
            all.push_back(net::Waitable::writable(outlet_.fd()));
        if (screen_ && screen_->has_keys())
            all.emplace_back(STDIN_FILENO);
    }
    std::optional<Outcome> wants_to_leave() override {
        return left_ || (options_.until.once && !shown_.empty()) ? std::optional(Outcome{})
                                                                 : std::nullopt;
    }

    Outcome finish(Outcome outcome, const net::SignalWatch* signals) {
        screen_.reset();
        const bool told =
            outcome.code == ExitCode::interrupted || outcome.code == ExitCode::terminated;
        if (const auto signal = told ? std::nullopt : outlet_.drain(signals))
            return outcome_of(*signal);
        return outcome;
    }
    [[nodiscard]] bool has_lost_output() const { return outlet_.has_failed(); }

private:
    void show() {
        if (screen_)
            return show_on_screen();
        if (!std::exchange(changed_, false) || !view_.known)
            return;
        if (options_.shared.json) {
            if (std::string text = farm_json(view_.farm) + "\n"; text != shown_)
                outlet_.put(shown_ = std::move(text));
            return;
        }
        FarmView compared = view_;
        compared.farm.broker.uptime = {}; // which alone is no news
        std::string text = farm_page(compared);
        if (text == shown_)
            return;
        outlet_.put((shown_.empty() ? "" : "\n") + farm_page(view_));
        shown_ = std::move(text);
    }
    void show_on_screen() {
        const Window window = screen_->window();
        if (!std::exchange(changed_, false) && window == drawn_in_)
            return;
        drawn_in_ = window;
        screen_->draw(farm_screen(view_, window));
    }

    const WatchOptions& options_;
    Console& console_;
    LossNotice loss_{console_};
    Outlet outlet_;
    std::optional<Screen> screen_;
    FarmView view_;
    bool changed_ = false; ///< since it was shown
    bool left_ = false;
    std::string shown_; ///< last, as far as it is news
    Window drawn_in_;
};

} // namespace

int watch_farm(const WatchOptions& options, Console& console, const net::SignalWatch* signals) {
    FarmListener listener(options, console);
    const net::Context context(options.shared.keys);
    FarmWatching watching(session_options(options.shared));
    // The table says itself whom it looks for.
    SearchingListener searching(
        listener, {console,
                   fills_screen(options) ? ProgressMode::none
                                         : ProgressReport::chosen(options.shared.progress, console),
                   options.shared.brokers, net::now()});
    const Outcome outcome =
        listener.finish(converse(context, watching, searching, signals), signals);
    if (outcome.code == ExitCode::unreachable || outcome.code == ExitCode::refused)
        console.error(outcome.reason);
    return static_cast<int>(console.checked(outcome.code, listener.has_lost_output()));
}

} // namespace fraja::client
