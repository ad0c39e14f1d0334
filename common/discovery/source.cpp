#include "common/discovery/source.hpp"

#include "common/base/text.hpp"
#include "common/net/endpoint.hpp"

#include <algorithm>

namespace fraja::discovery {
namespace {

constexpr std::size_t name_bytes_max = 253, label_bytes_max = 63; // RFC 1035

bool is_label(std::string_view label) {
    return !label.empty() && label.size() <= label_bytes_max &&
           std::ranges::all_of(label, [](char c) {
               return (c >= '0' && c <= '9') || (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') ||
                      c == '-' || c == '_';
           });
}

bool is_domain_name(std::string_view name) {
    if (name.size() > name_bytes_max)
        return false;
    for (;;) {
        const std::size_t dot = name.find('.');
        if (!is_label(name.substr(0, dot)))
            return false;
        if (dot == std::string_view::npos)
            return true;
        name.remove_prefix(dot + 1);
    }
}

Result<std::string> srv_word(std::string_view text) {
    std::string name(text.substr(srv_prefix.size()));
    if (name.ends_with('.'))
        name.pop_back();
    if (!name.starts_with('_'))
        name.insert(0, srv_service);
    if (!is_domain_name(name))
        return Error{ErrorCode::invalid_argument,
                     printable(clipped(text, name_bytes_max)) +
                         ": srv: and a domain name are wanted, as srv:example.org"};
    return std::string(srv_prefix) + name;
}

} // namespace

bool is_source(std::string_view word) {
    return word == beacon_source || word.starts_with(srv_prefix);
}

std::string srv_name(std::string_view source) {
    return std::string(source.substr(srv_prefix.size()));
}

Result<std::string> broker_word(std::string_view text) {
    if (text == beacon_source)
        return std::string(text);
    if (text.starts_with(srv_prefix))
        return srv_word(text);
    return net::endpoint_to_connect(text, net::broker_port);
}

Result<std::vector<std::string>> broker_words(const std::vector<std::string>& texts) {
    std::vector<std::string> words;
    for (const std::string& text : texts) {
        auto word = broker_word(text);
        if (!word)
            return word.error();
        if (std::ranges::find(words, *word) == words.end())
            words.push_back(*std::move(word));
    }
    if (std::ranges::count_if(words, is_source) > static_cast<std::ptrdiff_t>(sources_max))
        return Error{ErrorCode::invalid_argument,
                     "of auto and srv: at most " + std::to_string(sources_max)};
    return words;
}

} // namespace fraja::discovery
