#include "client/local/local_farm.hpp"

#include "broker/shell.hpp"
#include "common/base/guarded.hpp"
#include "common/net/descriptors.hpp"
#include "worker/shell.hpp"

#include <future>
#include <mutex>
#include <thread>
#include <utility>

namespace fraja::client {
namespace {

constexpr const char* session_endpoint = "inproc://fraja-local-broker";
constexpr const char* stream_endpoint = "inproc://fraja-local-stream";

} // namespace

struct LocalFarm::State {
    std::string endpoint;
    std::mutex mutex;
    std::optional<std::string> fault; // guarded by it
    broker::Control broker_control;
    worker::Control worker_control;
    std::jthread broker_thread, worker_thread;

    /// Starts the broker. It says where it listens, or why it does not.
    Result<void> start_broker(const net::Context& context, std::vector<std::string> call);
    void start_worker(const net::Context& context, worker::WorkerOptions options);
    void note(const char* who, const Error& error);

    /// The worker first, so that there is somebody to say Goodbye to.
    ~State() {
        worker_control.stop_now();
        if (worker_thread.joinable())
            worker_thread.join();
        broker_control.stop();
    }
};

Result<void> LocalFarm::State::start_broker(const net::Context& context,
                                            std::vector<std::string> call) {
    std::promise<Result<std::string>> promise;
    auto listening = promise.get_future();
    broker_thread =
        std::jthread([this, &context, p = std::move(promise), call = std::move(call)]() mutable {
            bool said = false;
            broker::Options options;
            options.bind = session_endpoint;
            options.publish = stream_endpoint;
            options.call = std::move(call);
            options.on_listening = [&](const std::string& bound, const std::string&) {
                said = true;
                p.set_value(bound);
            };
            const auto ran =
                guarded([&] { return broker::run_broker(context, options, broker_control); });
            if (!said)
                p.set_value(ran ? Error{ErrorCode::io, "the local broker ended"} : ran.error());
            else if (!ran)
                note("broker", ran.error());
        });
    auto bound = listening.get();
    if (!bound)
        return bound.error();
    endpoint = *std::move(bound);
    return {};
}

void LocalFarm::State::start_worker(const net::Context& context, worker::WorkerOptions options) {
    worker_thread = std::jthread([this, &context, options = std::move(options)] {
        const auto ran =
            guarded([&] { return worker::run_worker(context, options, worker_control); });
        if (!ran)
            note("worker", ran.error());
    });
}

void LocalFarm::State::note(const char* who, const Error& error) {
    const std::lock_guard lock(mutex);
    if (!fault)
        fault = std::string("the local ") + who + " ended: " + error.message;
}

Result<std::unique_ptr<LocalFarm>> LocalFarm::call(const net::Context& context,
                                                   const std::vector<std::string>& workers) {
    if (auto reserved = net::reserve_descriptors(workers.size()); !reserved)
        return reserved.error();
    auto state = std::make_unique<State>();
    if (auto started = state->start_broker(context, workers); !started)
        return started.error();
    return std::unique_ptr<LocalFarm>(new LocalFarm(std::move(state)));
}

Result<std::unique_ptr<LocalFarm>> LocalFarm::start(const net::Context& context,
                                                    std::uint32_t threads) {
    auto state = std::make_unique<State>();
    if (auto started = state->start_broker(context, {}); !started)
        return started.error();
    worker::WorkerOptions options;
    options.brokers = {state->endpoint};
    options.threads = threads != 0 ? threads : worker::usable_cpu_count();
    options.name = "local";
    if (const auto valid = worker::validate(options); !valid)
        return valid.error();
    state->start_worker(context, std::move(options));
    return std::unique_ptr<LocalFarm>(new LocalFarm(std::move(state)));
}

LocalFarm::LocalFarm(std::unique_ptr<State> state) : state_(std::move(state)) {}

LocalFarm::~LocalFarm() = default;

const std::string& LocalFarm::endpoint() const {
    return state_->endpoint;
}

std::optional<std::string> LocalFarm::fault() const {
    const std::lock_guard lock(state_->mutex);
    return state_->fault;
}

} // namespace fraja::client
