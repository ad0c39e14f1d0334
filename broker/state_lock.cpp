#include "broker/state_lock.hpp"

#include "common/base/text.hpp"

#include <cerrno>
#include <fcntl.h>
#include <string>
#include <sys/file.h>
#include <sys/stat.h>
#include <system_error>
#include <unistd.h>
#include <utility>

namespace fraja::broker {
namespace {

namespace fs = std::filesystem;

Error refused(const fs::path& path, const std::string& what, int number) {
    return {ErrorCode::io, path.string() + ": " + what + ": " +
                               std::error_code(number, std::generic_category()).message() +
                               ". Mend that, or give another --state"};
}

Result<void> make_directory(const fs::path& directory) {
    std::error_code ec;
    if (directory.has_parent_path())
        fs::create_directories(directory.parent_path(), ec); // if not, mkdir tells why
    if (::mkdir(directory.c_str(), 0700) != 0 && errno != EEXIST)
        return refused(directory, "cannot make this directory", errno);
    if (!fs::is_directory(directory, ec))
        return Error{ErrorCode::io,
                     directory.string() + ": this is no directory. Give another --state"};
    return {};
}

/// "process 4711": as it wrote there itself.
std::string holder(int fd) {
    char text[32] = {};
    const ssize_t n = ::pread(fd, text, sizeof text, 0);
    const auto pid = parse_count({text, n > 0 ? static_cast<std::size_t>(n) : 0});
    return pid ? "process " + std::to_string(*pid) : "its process is not known";
}

} // namespace

Result<StateLock> StateLock::take(const fs::path& directory) {
    if (const auto made = make_directory(directory); !made)
        return made.error();
    const fs::path file = directory / "lock";
    StateLock lock(::open(file.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0600));
    if (lock.fd_ < 0)
        return refused(file, "cannot write this file", errno);
    if (::flock(lock.fd_, LOCK_EX | LOCK_NB) != 0) {
        if (errno != EWOULDBLOCK)
            return refused(file, "cannot lock this file", errno);
        return Error{ErrorCode::in_use,
                     directory.string() + ": another fraja-broker is using it (" +
                         holder(lock.fd_) + "). Stop that, or give another --state"};
    }
    // It only helps a person: a full disk, on which this fails, is no reason not to start.
    const std::string pid = std::to_string(::getpid());
    [[maybe_unused]] const bool written =
        ::ftruncate(lock.fd_, 0) == 0 && ::pwrite(lock.fd_, pid.data(), pid.size(), 0) > 0;
    return lock;
}

StateLock::StateLock(StateLock&& other) noexcept : fd_(std::exchange(other.fd_, -1)) {}
StateLock& StateLock::operator=(StateLock&& other) noexcept {
    std::swap(fd_, other.fd_);
    return *this;
}
StateLock::~StateLock() {
    if (fd_ >= 0)
        ::close(fd_);
}

} // namespace fraja::broker
