// Somebody who pauses and cancels jobs and drains workers; when all heals, it is undone.
#pragma once

#include "client/asking.hpp"
#include "tests/sim/client_node.hpp"

#include <deque>
#include <memory>
#include <vector>

namespace fraja::sim {

class Administrator {
public:
    Administrator(Farm& farm, const Sites& sites,
                  const std::vector<std::unique_ptr<ClientNode>>& clients);

    /// One thing or other, unless the last is not through.
    void meddle();
    void undo_all();

private:
    void ask_next();
    [[nodiscard]] client::Question any_wish();

    Farm& farm_;
    const Sites& sites_;
    const std::vector<std::unique_ptr<ClientNode>>& clients_;
    CoreRunner runner_;
    std::deque<client::Question> wishes_;
};

} // namespace fraja::sim
