// Canvas: the newest state of the picture that tev is to have, and what of it is still to be sent.
#pragma once

#include "common/base/bytes.hpp"
#include "common/image/film.hpp"

#include <cstddef>
#include <deque>
#include <optional>
#include <string>
#include <vector>

namespace fraja::client::tev {

/// A packet's pixels, about: what is being sent is finished, however slow tev is.
inline constexpr std::size_t update_bytes = std::size_t{1} << 20;
/// More places than these are sent as the rectangle around them all.
inline constexpr std::size_t dirty_max = 256;

class Canvas {
public:
    /// Another picture, black.
    void begin(std::string name, const Film& film);
    /// What is there is copied; `rect` lies in the film's region. The film must be the one of
    /// begin(), or one like it.
    void update(PixelRect rect, const Film& film);

    /// From the beginning again, for a tev that knows nothing of it.
    void send_all();
    [[nodiscard]] bool is_dirty() const { return create_ || !dirty_.empty(); }
    /// Takes what is to be sent from now to the end of this flush; what changes meanwhile is for
    /// the next, but what is taken goes out as it is then.
    void begin_flush();
    /// The next packet of the flush, if there is one.
    [[nodiscard]] std::optional<Bytes> next_packet();

private:
    void mark(PixelRect rect);

    std::string name_;
    PixelRect region_;
    std::vector<float> rgb_;
    bool create_ = false;          ///< it is to be made at first
    std::vector<PixelRect> dirty_; ///< counted from the region's corner
    std::deque<Bytes> opening_;    ///< of this flush; then
    std::deque<PixelRect> flush_;
};

} // namespace fraja::client::tev
