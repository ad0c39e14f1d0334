#include "client/page/heat_map.hpp"

#include <algorithm>
#include <cmath>

namespace fraja::client {
namespace {

constexpr double cost_range_max = 1e4;
constexpr float cost_min = 1e-12f; // of a cell that took no time to be measured

/// 0..1 each.
Srgb8 from_hsl(double hue, double saturation, double lightness) {
    const double reach = saturation * std::min(lightness, 1 - lightness);
    const auto channel = [&](double offset) {
        const double k = std::fmod(offset + 12 * hue, 12.0);
        const double level = lightness - reach * std::clamp(std::min(k - 3, 9 - k), -1.0, 1.0);
        return static_cast<std::uint8_t>(std::lround(255 * level));
    };
    return {channel(0), channel(8), channel(4)};
}

} // namespace

Srgb8 cost_colour(double share) {
    struct Stop {
        double r, g, b;
    };
    constexpr std::array<Stop, 6> stops = {{{28, 16, 68},
                                            {52, 66, 140},
                                            {33, 125, 142},
                                            {53, 183, 121},
                                            {170, 220, 50},
                                            {253, 240, 130}}};
    const double at = std::clamp(share, 0.0, 1.0) * (stops.size() - 1);
    const auto below = std::min(static_cast<std::size_t>(at), stops.size() - 2);
    const double t = at - static_cast<double>(below);
    const auto mix = [&](double Stop::*channel) {
        const double level = (1 - t) * stops[below].*channel + t * stops[below + 1].*channel;
        return static_cast<std::uint8_t>(std::lround(level));
    };
    return {mix(&Stop::r), mix(&Stop::g), mix(&Stop::b)};
}

Srgb8 worker_colour(std::size_t index) {
    constexpr double golden = 0.6180339887498949; // never comes near an earlier hue soon
    constexpr std::array<double, 3> lightnesses = {0.52, 0.68, 0.38};
    const double hue = std::fmod(0.58 + golden * static_cast<double>(index), 1.0);
    return from_hsl(hue, 0.65, lightnesses[index % lightnesses.size()]);
}

HeatMap::HeatMap(const PixelRect& crop, std::uint32_t cell_side)
    : crop_(crop), grid_(crop, cell_side), cells_(grid_.count()) {}

void HeatMap::withdraw(const PixelRect& rect) {
    const auto cells = grid_.cells(rect);
    FRAJA_ASSERT(cells.has_value());
    grid_.all_of(*cells, [&](std::uint64_t index) {
        cells_[index] = {};
        return true;
    });
}

void HeatMap::add(const protocol::TileDone& tile) {
    const auto cells = grid_.cells(tile.rect);
    FRAJA_ASSERT(cells.has_value());
    const auto pixels = static_cast<double>(tile.rect.pixel_count());
    const auto cost = std::max(cost_min, static_cast<float>(seconds(tile.elapsed) / pixels));
    const std::size_t worker = number_of(tile.worker_name);
    ++shares_[worker].tiles;
    grid_.all_of(*cells, [&](std::uint64_t index) {
        cells_[index].cost += cost;
        cells_[index].worker = static_cast<std::uint16_t>(worker);
        return true;
    });
}

std::size_t HeatMap::number_of(const std::string& worker) {
    if (const auto known = numbers_.find(worker); known != numbers_.end())
        return known->second;
    if (shares_.size() == map_workers_max) {
        shares_.back().name = "others";
        return map_workers_max - 1;
    }
    const std::size_t number = shares_.size();
    shares_.push_back({worker, 0});
    numbers_.emplace(worker, number);
    return number;
}

template <class ColourOf>
LevelsPicture HeatMap::painted(ColourOf colour_of) const {
    const protocol::CellRect all = grid_.all();
    LevelsPicture picture{{all.width, all.height}, std::vector<std::uint8_t>(3 * cells_.size())};
    auto to = picture.rgb.begin();
    for (const Cell& cell : cells_) {
        const Srgb8 colour = cell.cost > 0 ? colour_of(cell) : Srgb8{};
        to = std::ranges::copy(colour, to).out;
    }
    return picture;
}

LevelsPicture HeatMap::costs() const {
    const Costs ends = scale();
    const double range = std::log(ends.most / std::max(ends.least, double{cost_min}));
    return painted([&](const Cell& cell) {
        const double above = std::log(std::max(double{cell.cost}, ends.least) / ends.least);
        return cost_colour(range > 0 ? above / range : 0.5);
    });
}

LevelsPicture HeatMap::workers() const {
    return painted([](const Cell& cell) { return worker_colour(cell.worker); });
}

PixelRect HeatMap::covered() const {
    const protocol::CellRect all = grid_.all();
    const std::uint32_t side = grid_.side();
    return {crop_.x / side * side, crop_.y / side * side, all.width * side, all.height * side};
}

HeatMap::Costs HeatMap::scale() const {
    Costs ends;
    for (const Cell& cell : cells_) {
        if (cell.cost <= 0)
            continue;
        ends.most = std::max(ends.most, double{cell.cost});
        ends.least = ends.least == 0 ? double{cell.cost} : std::min(ends.least, double{cell.cost});
    }
    ends.least = std::max(ends.least, ends.most / cost_range_max);
    return ends;
}

} // namespace fraja::client
