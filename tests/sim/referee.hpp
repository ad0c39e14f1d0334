// Referee: watches what a broker does, and says where it breaks a promise.
#pragma once

#include "broker/events.hpp"
#include "common/protocol/cells.hpp"
#include "tests/sim/farm.hpp"

#include <cstdint>
#include <functional>
#include <map>
#include <set>
#include <vector>

namespace fraja::sim {

class Referee {
public:
    explicit Referee(Farm& farm) : farm_(farm) {}

    /// A broker begins, with what it has found; null: it keeps nothing.
    void begin(const broker::Contents* contents);
    /// Before it is done.
    void look_at(const broker::Action& action);

private:
    struct Taken {
        std::uint32_t pass = 0;
        PixelRect rect;
        WorkerId worker;
    };
    struct Watched {
        protocol::CellGrid grid;
        std::vector<bool> done{};      ///< cells of all passes, as far as is known
        std::uint64_t done_count = 0;  ///< of these
        std::uint32_t told_count = 0;  ///< in this epoch
        std::uint64_t epoch = 0;       ///< the last that was told
        std::uint32_t number = 0;      ///< likewise
        protocol::Revision revision{}; ///< likewise
        std::vector<Taken> tiles{};
        std::set<WorkerId> struck{}; ///< workers whose tiles do not count
    };
    [[nodiscard]] Watched& watched(const JobId& job);
    /// Whose cells, and how many of them are new now.
    std::uint64_t take(const JobId& job, std::uint32_t pass, const PixelRect& rect,
                       const WorkerId& worker);
    std::uint64_t mark(Watched& w, const JobId& job, const Taken& tile);
    void strike(const JobId& job, const WorkerId& worker);
    void drop(Watched& w, const JobId& job, const std::function<bool(const Taken&)>& which);
    void drop(const JobId& job, const broker::PutDistrusted::Tile& which);
    [[nodiscard]] bool is_done(const JobId& job, std::uint32_t pass, const PixelRect& rect);
    void look_at(const protocol::Message& message);
    void look_at(const protocol::RenderTile& order);
    void look_at(const protocol::JobState& state);
    void violation(const JobId& job, const std::string& what);

    Farm& farm_;
    bool keeps_ = false;
    std::map<JobId, Watched> jobs_;
};

} // namespace fraja::sim
