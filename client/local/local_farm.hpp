// LocalFarm: a broker in this process, with a worker here, for --local, or workers elsewhere that
// it calls, for --direct. The only place where programs include one another.
#pragma once

#include "common/base/instant.hpp"
#include "common/base/result.hpp"
#include "common/net/sockets.hpp"

#include <chrono>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace fraja::client {

class LocalFarm {
public:
    /// Starts both, on inproc endpoints of `context`, which must outlive this. `threads` 0: every
    /// CPU that this process may use. Signals should be blocked before.
    [[nodiscard]] static Result<std::unique_ptr<LocalFarm>> start(const net::Context& context,
                                                                  std::uint32_t threads);
    /// Starts the broker alone and has it call workers that listen, at these endpoints. Whether
    /// they answer shows in the job.
    [[nodiscard]] static Result<std::unique_ptr<LocalFarm>>
    call(const net::Context& context, const std::vector<std::string>& workers);
    /// Drops what is being rendered.
    ~LocalFarm();
    LocalFarm(const LocalFarm&) = delete;
    LocalFarm& operator=(const LocalFarm&) = delete;

    [[nodiscard]] const std::string& endpoint() const;
    /// Why a part of it has ended by itself, for want of memory or threads: nothing comes any more.
    [[nodiscard]] std::optional<std::string> fault() const;
    /// The broker is there, however long this process is kept from running: --connect-timeout is
    /// about others.
    static constexpr Duration answers_within = std::chrono::hours(24);

private:
    struct State;
    explicit LocalFarm(std::unique_ptr<State> state);
    std::unique_ptr<State> state_;
};

} // namespace fraja::client
