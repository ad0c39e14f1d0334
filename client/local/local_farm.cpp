#include "client/local/local_farm.hpp"

#include "broker/shell.hpp"
#include "worker/shell.hpp"

#include <future>
#include <thread>
#include <utility>

namespace fraja::client {
namespace {

constexpr const char* session_endpoint = "inproc://fraja-local-broker";
constexpr const char* stream_endpoint = "inproc://fraja-local-stream";

} // namespace

struct LocalFarm::State {
    std::string endpoint;
    broker::Control broker_control;
    worker::Control worker_control;
    std::jthread broker_thread, worker_thread;

    /// The worker first, so that there is somebody to say Goodbye to.
    ~State() {
        worker_control.stop_now();
        if (worker_thread.joinable())
            worker_thread.join();
        broker_control.stop();
    }
};

Result<std::unique_ptr<LocalFarm>> LocalFarm::start(const net::Context& context,
                                                    std::uint32_t threads) {
    auto state = std::make_unique<State>();
    // The broker says where it listens, or why it does not.
    std::promise<Result<std::string>> promise;
    auto listening = promise.get_future();
    state->broker_thread = std::jthread(
        [&context, &control = state->broker_control, p = std::move(promise)]() mutable {
            bool said = false;
            broker::Options options;
            options.bind = session_endpoint;
            options.publish = stream_endpoint;
            options.on_listening = [&](const std::string& bound, const std::string&) {
                said = true;
                p.set_value(bound);
            };
            const auto ran = broker::run_broker(context, options, control);
            if (!said)
                p.set_value(ran ? Error{ErrorCode::io, "the local broker ended"} : ran.error());
        });
    auto endpoint = listening.get();
    if (!endpoint)
        return endpoint.error();
    state->endpoint = *endpoint;

    worker::WorkerOptions options;
    options.brokers = {state->endpoint};
    options.threads = threads != 0 ? threads : worker::usable_cpu_count();
    options.name = "local";
    if (const auto valid = worker::validate(options); !valid)
        return valid.error();
    state->worker_thread = std::jthread([&context, &control = state->worker_control, options] {
        // It can only fail where its options are wrong: those are checked.
        (void)worker::run_worker(context, options, control);
    });
    return std::unique_ptr<LocalFarm>(new LocalFarm(std::move(state)));
}

LocalFarm::LocalFarm(std::unique_ptr<State> state) : state_(std::move(state)) {}

LocalFarm::~LocalFarm() = default;

const std::string& LocalFarm::endpoint() const {
    return state_->endpoint;
}

} // namespace fraja::client
