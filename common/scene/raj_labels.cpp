#include "common/scene/raj_labels.hpp"

#include "common/base/text.hpp"

#include <algorithm>
#include <random>
#include <span>

namespace fraja::raj {
namespace {

constexpr std::size_t names_compared_max = 10'000; // with one that is unknown

/// a * b modulo the prime 2^61 - 1; both below it.
std::uint64_t multiply_mod_prime(std::uint64_t a, std::uint64_t b) {
    constexpr std::uint64_t prime = (std::uint64_t{1} << 61) - 1;
    __extension__ using Wide = unsigned __int128;
    const Wide product = Wide{a} * b;
    const std::uint64_t sum =
        static_cast<std::uint64_t>(product & prime) + static_cast<std::uint64_t>(product >> 61);
    return sum >= prime ? sum - prime : sum;
}

} // namespace

LabelHash::LabelHash() {
    std::random_device device;
    point_ = (std::uint64_t{device() & 0x0fffffffu} << 32 | device()) + 1000; // below 2^61 - 1
}

std::size_t LabelHash::operator()(std::string_view label) const {
    std::uint64_t h = 0;
    for (const char c : label)
        h = multiply_mod_prime(h + static_cast<unsigned char>(c) + 1, point_);
    return h;
}

bool Labels::close(std::string_view label, const Value& object) {
    open_.pop_back();
    const auto number = static_cast<std::uint32_t>(names_.size());
    const auto [entry, is_new] = numbers_.try_emplace(label, number);
    if (!is_new) {
        diagnostics_.warn(object.place, "label " + quoted(label) + " is defined again");
        values_[entry->second] = object;
        return true;
    }
    if (names_.size() >= limits_.labels)
        return diagnostics_.refuse_limit(object.place, "labels", limits_.labels, "labels");
    names_.push_back(label);
    values_.push_back(object);
    return true;
}

bool Labels::find(std::string_view label, Place place, Value& value) const {
    const auto entry = numbers_.find(label);
    if (entry != numbers_.end()) {
        value = values_[entry->second];
        return true;
    }
    if (std::ranges::find(open_, label) != open_.end())
        return diagnostics_.refuse(place, "label " + quoted(label) + " is used in its own object");
    const std::span<const std::string_view> names(names_);
    return diagnostics_.refuse(
        place, "no label " + quoted(label) + " has been defined before this" +
                   did_you_mean(nearest_name(
                       label, names.last(std::min(names.size(), names_compared_max)))));
}

} // namespace fraja::raj
