#include "client/tev/packets.hpp"

#include "common/base/assert.hpp"

#include <bit>
#include <cstring>

namespace fraja::client::tev {
namespace {

enum class Type : std::uint8_t { close = 2, create = 4, update = 6 };
constexpr std::string_view channels[] = {"R", "G", "B"};

/// A packet that grows; its length is known at the end.
class Packet {
public:
    explicit Packet(Type type) : bytes_(sizeof(std::uint32_t)) { put(type); }

    template <class T>
    Packet& put(T value) {
        static_assert(std::endian::native == std::endian::little, "numbers go out as they are");
        return put_bytes(&value, sizeof value);
    }
    Packet& put_text(std::string_view text) {
        FRAJA_ASSERT(text.find('\0') == std::string_view::npos);
        return put_bytes(text.data(), text.size()).put(std::uint8_t{0});
    }
    Packet& put_channels() {
        put(static_cast<std::int32_t>(std::size(channels)));
        for (const std::string_view channel : channels)
            put_text(channel);
        return *this;
    }
    Packet& put_bytes(const void* data, std::size_t size) {
        const std::size_t at = bytes_.size();
        bytes_.resize(at + size);
        if (size > 0)
            std::memcpy(bytes_.data() + at, data, size);
        return *this;
    }
    [[nodiscard]] Bytes done() && {
        const auto length = static_cast<std::uint32_t>(bytes_.size());
        std::memcpy(bytes_.data(), &length, sizeof length);
        return std::move(bytes_);
    }

private:
    Bytes bytes_;
};

std::int32_t i32(std::uint32_t value) {
    return static_cast<std::int32_t>(value);
}

} // namespace

Bytes create_image(std::string_view name, bool focus, Extent size) {
    Packet packet(Type::create);
    packet.put(focus).put_text(name).put(i32(size.width)).put(i32(size.height)).put_channels();
    return std::move(packet).done();
}

Bytes update_image(std::string_view name, PixelRect rect, std::span<const float> rgb) {
    FRAJA_ASSERT(rgb.size() == 3 * rect.pixel_count());
    Packet packet(Type::update);
    packet.put(false).put_text(name).put_channels();
    for (const std::uint32_t side : {rect.x, rect.y, rect.width, rect.height})
        packet.put(i32(side));
    for (const std::int64_t offset : {0, 1, 2})
        packet.put(offset);
    for (const std::int64_t stride : {3, 3, 3})
        packet.put(stride);
    packet.put_bytes(rgb.data(), rgb.size_bytes());
    return std::move(packet).done();
}

Bytes close_image(std::string_view name) {
    Packet packet(Type::close);
    packet.put_text(name);
    return std::move(packet).done();
}

} // namespace fraja::client::tev
