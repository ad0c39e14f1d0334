#include "common/image_io/replace_file.hpp"

#include "common/base/ids.hpp"

#include <cerrno>
#include <cstdio>
#include <fcntl.h>
#include <string>
#include <system_error>
#include <unistd.h>
#include <utility>

namespace fraja {
namespace {

namespace fs = std::filesystem;

std::string errno_text() {
    return std::error_code(errno, std::generic_category()).message();
}

/// The file that `path` means, which may not exist yet: where its last part is a symbolic link,
/// what that points to. After as many links as Linux itself would follow, wherever one is.
fs::path follow_links(fs::path path) {
    std::error_code ec;
    for (int i = 0; i < 40 && fs::is_symlink(path, ec); ++i)
        path = path.parent_path() / fs::read_symlink(path, ec); // an absolute one replaces all
    return path;
}

/// A file beside its target, open for writing; removed unless it was moved there.
class PendingFile {
public:
    explicit PendingFile(const fs::path& path) {
        target_ = follow_links(path);
        // A dot hides it from listings; the id keeps two programs that write one picture apart.
        path_ = target_.parent_path() / (".fraja-" + to_string(random_id<Nonce>()));
        fd_ = ::open(path_.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
    }
    ~PendingFile() {
        if (fd_ >= 0)
            ::close(fd_);
        if (created())
            ::unlink(path_.c_str()); // after a rename there is nothing of that name
    }
    PendingFile(const PendingFile&) = delete;
    PendingFile& operator=(const PendingFile&) = delete;

    /// If not, errno tells why.
    [[nodiscard]] bool created() const { return fd_ >= 0 || closed_; }

    // These are false where the system refuses; errno tells why.
    bool write(std::span<const std::byte> bytes) {
        while (!bytes.empty()) {
            const ssize_t n = ::write(fd_, bytes.data(), bytes.size());
            if (n < 0 && errno != EINTR)
                return false;
            bytes = bytes.subspan(n < 0 ? 0 : static_cast<std::size_t>(n));
        }
        return true;
    }
    bool close() {
        closed_ = true;
        return ::close(std::exchange(fd_, -1)) == 0; // a full disk may show only here
    }
    bool move_to_target() { return std::rename(path_.c_str(), target_.c_str()) == 0; }

private:
    fs::path target_, path_;
    int fd_ = -1;
    bool closed_ = false;
};

} // namespace

Result<void> replace_file(const fs::path& path, std::span<const std::byte> bytes) {
    PendingFile file(path);
    if (!file.created() || !file.write(bytes) || !file.close() || !file.move_to_target())
        return io_error(path, errno_text());
    return {};
}

Result<void> check_replaceable(const fs::path& path) {
    std::error_code ec;
    const fs::file_status there = fs::status(path, ec);
    if (fs::is_directory(there))
        return io_error(path, "this is a directory");
    if (fs::exists(there) && !fs::is_regular_file(there))
        return io_error(path, "this is no ordinary file");
    if (fs::exists(there) && ::access(path.c_str(), W_OK) != 0)
        return io_error(path, errno_text());
    if (ec && there.type() != fs::file_type::not_found)
        return io_error(path, ec.message());
    const fs::path folder = path.has_parent_path() ? path.parent_path() : ".";
    if (!fs::is_directory(folder, ec) && !fs::is_symlink(path, ec))
        return io_error(path, "there is no directory " + folder.string());
    if (!PendingFile(path).created())
        return io_error(path, "no file can be made there: " + errno_text());
    return {};
}

} // namespace fraja
