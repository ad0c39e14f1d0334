#include "client/page/page.hpp"

#include "client/asking.hpp"
#include "client/json.hpp"
#include "client/notices.hpp"
#include "client/page/routes.hpp"
#include "client/page/token.hpp"
#include "common/http/server.hpp"
#include "common/image_io/picture_codec.hpp"
#include "common/net/clock.hpp"

#include <chrono>
#include <cstdio>
#include <fmt/core.h>
#include <functional>
#include <unistd.h>
#include <utility>

namespace fraja::client {
namespace {

using namespace std::chrono_literals;

constexpr Duration control_patience = 5s;       // for a broker to answer
constexpr Duration viewer_patience = 24h * 365; // a job is looked for as long as somebody looks

class StateCatcher final : public Listener {
public:
    explicit StateCatcher(Duration patience) : patience_(patience) {}

    void hear(Instant, const News& news) override {
        if (const auto* changed = std::get_if<StateChanged>(&news))
            state = changed->state;
    }
    Instant tick(Instant now) override {
        if (ends_ == Instant::never())
            ends_ = now + patience_;
        late_ = now >= ends_;
        return ends_;
    }
    std::optional<Outcome> wants_to_leave() override {
        return late_ ? std::optional(
                           Outcome{ExitCode::unreachable, "The broker does not answer: try again."})
                     : std::nullopt;
    }
    std::optional<protocol::JobState> state;

private:
    Duration patience_;
    Instant ends_ = Instant::never();
    bool late_ = false;
};

/// A board that is opened to viewers when a broker is there: else what they look at would be gone
/// after --connect-timeout.
class Opening final : public Listener {
public:
    Opening(FarmBoard& board, std::function<void()> open) : board_(board), open_(std::move(open)) {}
    void hear(Instant now, const News& news) override {
        board_.hear(now, news);
        if (open_ && std::holds_alternative<ConnectionChanged>(news))
            std::exchange(open_, nullptr)();
    }
    Instant tick(Instant now) override { return board_.tick(now); }
    void wait_also(std::vector<net::Waitable>& all) const override { board_.wait_also(all); }
    std::optional<Outcome> wants_to_leave() override { return board_.wants_to_leave(); }

private:
    FarmBoard& board_;
    std::function<void()> open_;
};

class PageProgram {
public:
    PageProgram(const WatchOptions& options, const net::SignalWatch* signals)
        : options_(options), signals_(signals), console_(options.shared.console),
          context_(options.shared.keys) {}

    int run() {
        const Outcome outcome = serve();
        const bool said =
            outcome.code == ExitCode::interrupted || outcome.code == ExitCode::terminated;
        if (outcome.code != ExitCode::done && !said)
            console_.error(outcome.reason);
        return static_cast<int>(console_.checked(outcome.code));
    }

private:
    Outcome serve() {
        auto address = parse_page_address(options_.serve->at);
        if (!address)
            return {ExitCode::usage, address.error().message};
        if (const auto codec = picture_codec(); !codec)
            return {ExitCode::usage, codec.error().message};
        const auto token = choose_token(*address);
        if (!token)
            return {ExitCode::usage, token.error().message};
        FarmPage page{.farm = {},
                      .meters = {},
                      .broker = options_.shared.brokers.front(),
                      .allow_control = options_.serve->allow_control,
                      .first_job = {}};
        if (options_.job) {
            StateCatcher catcher(viewer_patience);
            Asking asking(JobQuestion{*options_.job}, session_options(options_.shared));
            if (Outcome found = converse(context_, asking, catcher, signals_);
                found.code != ExitCode::done)
                return found;
            page.first_job = fraja::to_string(catcher.state->job);
        }
        JobViews views({}, [this](JobView& view) { return watch(view); });
        FarmBoard board(std::move(page), views);
        Control control;
        if (options_.serve->allow_control)
            control = [this](const JobId& job, protocol::JobDeed deed) { return order(job, deed); };
        std::optional<Routes> routes;
        auto server = http::Server::bind(
            {address->host, address->port},
            {.answer = [&](const http::Request& request) { return routes->answer(request); },
             .always = page_headers(),
             .limits = page_limits});
        if (!server)
            return {ExitCode::usage, "--serve: " + server.error().message};
        address->port = server->address().port;
        routes.emplace(Door(*address, *token), board, views, std::move(control));
        Opening opening(board, [&] {
            server->serve();
            announce(*address, *token);
        });
        SearchingListener searching(opening, SearchNotice(console_, ProgressMode::plain,
                                                          options_.shared.brokers, net::now()));
        FarmWatching watching(session_options(options_.shared));
        return converse(context_, watching, searching, signals_);
    }

    [[nodiscard]] Result<std::string> choose_token(const PageAddress& address) {
        if (!options_.serve->token_file.empty())
            return read_token(options_.serve->token_file);
        return address.loopback ? std::string() : fresh_token();
    }

    void announce(const PageAddress& address, const std::string& token) {
        if (!address.loopback)
            console_.warning("the page and its token go over the network as they are: on one you "
                             "do not trust, serve on loopback and come by ssh -L");
        char machine[256] = {};
        gethostname(machine, sizeof machine - 1);
        const bool is_secret = !options_.serve->token_file.empty();
        fmt::print("page {}\n", page_url(address, machine, is_secret ? "" : token));
        std::fflush(stdout);
    }

    Outcome watch(JobView& view) {
        SessionOptions session = session_options(options_.shared);
        session.connect_timeout = viewer_patience;
        JobWatching watching({fraja::to_string(view.job()), session, {}}, fresh_rng());
        return converse(context_, watching, view, nullptr);
    }

    Outcome order(const JobId& job, protocol::JobDeed deed) {
        SessionOptions session = session_options(options_.shared);
        session.connect_timeout = control_patience;
        StateCatcher catcher(control_patience);
        Asking asking(JobQuestion{fraja::to_string(job), deed}, std::move(session));
        Outcome outcome = converse(context_, asking, catcher, nullptr);
        if (outcome.code == ExitCode::done)
            outcome.reason =
                fmt::format("#{} is {}", catcher.state->number, to_string(catcher.state->phase));
        return outcome;
    }

    const WatchOptions& options_;
    const net::SignalWatch* signals_;
    Console console_;
    const net::Context context_;
};

} // namespace

int run_page(const WatchOptions& options, const net::SignalWatch* signals) {
    return PageProgram(options, signals).run();
}

} // namespace fraja::client
