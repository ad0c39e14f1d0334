#include "common/net/allow_list.hpp"

#include "common/base/text.hpp"
#include "common/protocol/limits.hpp"

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>
#include <vector>

namespace fraja::net {
namespace {

constexpr std::string_view blanks = " \t\r";

std::string_view trimmed(std::string_view text) {
    text.remove_prefix(std::min(text.find_first_not_of(blanks), text.size()));
    return text.substr(0, text.find_last_not_of(blanks) + 1);
}

std::string_view take_word(std::string_view& line) {
    const std::string_view word = line.substr(0, line.find_first_of(blanks));
    line = trimmed(line.substr(word.size()));
    return word;
}

/// A worker's role, by a key that many machines have.
constexpr std::string_view shared_worker = "workers";

Result<void> parse_roles(std::string_view text, protocol::KeyHolder& holder) {
    for (;;) {
        const std::string_view word = text.substr(0, text.find(','));
        const auto role =
            word == shared_worker ? protocol::Role::worker : protocol::parse_role(word);
        if (!role) {
            auto names = protocol::role_names();
            names.push_back(shared_worker);
            return Error{ErrorCode::invalid_argument,
                         "there is no role '" + printable(clipped(word, 100)) + "'" +
                             did_you_mean(meant_name(word, names)) +
                             ": worker, workers, submit, watch or admin, several as submit,admin"};
        }
        holder.roles.add(*role);
        holder.is_shared = holder.is_shared || word == shared_worker;
        if (word.size() == text.size())
            return {};
        text.remove_prefix(word.size() + 1);
    }
}

Result<protocol::KeyHolder> parse_line(std::string_view line) {
    protocol::KeyHolder holder;
    if (const auto roles = parse_roles(take_word(line), holder); !roles)
        return roles.error();
    const auto key = parse_public_key(take_word(line));
    if (!key)
        return key.error();
    if (line.empty() || line.size() > protocol::name_bytes_max)
        return Error{ErrorCode::invalid_argument, "behind the key stands whose it is, in 1 to " +
                                                      std::to_string(protocol::name_bytes_max) +
                                                      " bytes"};
    holder.key = key->text;
    holder.name = printable(line);
    return holder;
}

Error unreadable(const std::string& file, const std::string& why) {
    return {ErrorCode::io, file + ": " + why};
}

} // namespace

Result<AllowList> AllowList::parse(std::string_view text, const std::string& file) {
    AllowList list;
    std::unordered_map<std::string, std::size_t> lines;
    for (std::size_t number = 1; !text.empty(); ++number) {
        const auto wrong = [&](ErrorCode code, const std::string& what) {
            return Error{code, file + ":" + std::to_string(number) + ": " + what};
        };
        const std::size_t end = text.find('\n');
        const std::string_view whole = text.substr(0, end);
        text.remove_prefix(end == std::string_view::npos ? text.size() : end + 1);
        if (whole.size() > allow_line_bytes_max)
            return wrong(ErrorCode::limit_exceeded,
                         "a line has at most " + std::to_string(allow_line_bytes_max) + " bytes");
        const std::string_view line = trimmed(whole);
        if (line.empty() || line.starts_with('#'))
            continue;
        auto holder = parse_line(line);
        if (!holder)
            return wrong(holder.error().code, holder.error().message);
        if (const auto [known, is_new] = lines.emplace(holder->key, number); !is_new)
            return wrong(ErrorCode::invalid_argument,
                         "that key stands in line " + std::to_string(known->second) +
                             " already: a key has one line, with all its roles");
        if (list.holders_.size() >= allow_entries_max)
            return wrong(ErrorCode::limit_exceeded,
                         "there are at most " + std::to_string(allow_entries_max) + " keys");
        std::string key = holder->key;
        list.holders_.emplace(std::move(key),
                              std::make_shared<protocol::KeyHolder>(*std::move(holder)));
    }
    return list;
}

Result<AllowList> AllowList::read(const std::filesystem::path& file) {
    const int fd = ::open(file.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK);
    if (fd < 0)
        return unreadable(file.string(), std::strerror(errno));
    struct Closer {
        int fd;
        ~Closer() { ::close(fd); }
    } const closer{fd};
    struct stat status {};
    if (fstat(fd, &status) != 0 || !S_ISREG(status.st_mode))
        return unreadable(file.string(), "it is no file");
    if (status.st_uid != geteuid() && status.st_uid != 0)
        return Error{ErrorCode::io,
                     file.string() +
                         ": it is somebody else's file, who can give himself any role: chown " +
                         std::to_string(geteuid()) + " " + file.string() + ", or have your own"};
    if ((status.st_mode & (S_IWGRP | S_IWOTH)) != 0)
        return Error{ErrorCode::io, file.string() +
                                        ": others than its owner may write to it, and so give "
                                        "themselves any role: chmod go-w " +
                                        file.string()};
    std::string text;
    std::array<char, 65'536> part;
    for (ssize_t n = 0; (n = ::read(fd, part.data(), part.size())) != 0;) {
        if (n < 0 && errno == EINTR)
            continue;
        if (n < 0)
            return unreadable(file.string(), std::strerror(errno));
        text.append(part.data(), static_cast<std::size_t>(n));
        if (text.size() > allow_file_bytes_max)
            return Error{ErrorCode::limit_exceeded, file.string() + ": an allow-list has at most " +
                                                        std::to_string(allow_file_bytes_max) +
                                                        " bytes"};
    }
    return parse(text, file.string());
}

void AllowList::add_brokers(const PublicKey& own) {
    holders_[own.text] = std::make_shared<protocol::KeyHolder>(
        protocol::KeyHolder{own.text, "a broker of this farm", {protocol::Role::broker}});
}

AllowList::Holder AllowList::find(const std::string& key) const {
    const auto found = holders_.find(key);
    return found == holders_.end() ? nullptr : found->second;
}

std::map<std::string, protocol::Roles> AllowList::roles() const {
    std::map<std::string, protocol::Roles> all;
    for (const auto& [key, holder] : holders_)
        all[key] = holder->roles;
    return all;
}

bool AllowList::followers_lost_in(const AllowList& later) const {
    return std::ranges::any_of(holders_, [&](const auto& entry) {
        const Holder then = later.find(entry.first);
        return entry.second->roles.has_any(protocol::client_roles) &&
               !(then && then->roles.has_any(protocol::client_roles));
    });
}

} // namespace fraja::net
