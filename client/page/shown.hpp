// Text that many look at and that is made anew when what it tells has changed and somebody looks.
#pragma once

#include "common/http/message.hpp"

#include <cstdint>
#include <utility>

namespace fraja::client {

/// What somebody sees who looks now.
struct Shown {
    std::uint64_t version = 0; ///< grows with every change
    http::Body text;
};

/// Guarded by its owner.
class ShownText {
public:
    void change() { ++version_; }
    template <class Describe>
    [[nodiscard]] Shown look(Describe describe) {
        if (!shown_.text || shown_.version != version_)
            shown_ = {version_, http::body(describe())};
        return shown_;
    }

private:
    std::uint64_t version_ = 1;
    Shown shown_;
};

} // namespace fraja::client
