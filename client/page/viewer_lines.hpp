// The lines of one viewer: the farm and the job that is looked at, whenever they have changed.
#pragma once

#include "client/page/farm_board.hpp"

#include <cstdint>
#include <memory>

namespace fraja::client {

class ViewerLines final : public http::LineSource {
public:
    /// `viewer` may be null: the farm alone.
    ViewerLines(FarmBoard& board, std::shared_ptr<Viewer> viewer);

    /// An empty object where nothing has changed for a while: so a viewer knows that the page is
    /// still there, and the server that the viewer is.
    [[nodiscard]] std::string next(Instant now) override;

private:
    FarmBoard& board_;
    std::shared_ptr<Viewer> viewer_;
    std::uint64_t farm_seen_ = 0, job_seen_ = 0; ///< versions, which count from 1
    Instant beat_due_{};
};

} // namespace fraja::client
