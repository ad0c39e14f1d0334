#include "common/cli/key_file.hpp"

#include "common/base/z85.hpp"

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <fcntl.h>
#include <optional>
#include <string_view>
#include <sys/stat.h>
#include <toml++/toml.h>
#include <unistd.h>
#include <utility>

namespace fraja::cli {
namespace {

/// Closed, and what was read of it wiped, in the end.
struct File {
    int fd = -1;
    std::string text;
    explicit File(int descriptor) : fd(descriptor) { text.reserve(key_file_bytes_max + 1); }
    ~File() {
        explicit_bzero(text.data(), text.size());
        if (fd >= 0)
            ::close(fd);
    }
    File(const File&) = delete;
    File& operator=(const File&) = delete;
};

Error trouble(const std::filesystem::path& file, const std::string& what,
              ErrorCode code = ErrorCode::io) {
    return {code, file.string() + ": " + what};
}

/// Somebody may have typed the secret itself, which is as long as any key in Z85 (RFC 32).
bool may_be_key(std::string_view text) {
    constexpr std::size_t key_characters = 40;
    return text.size() == key_characters && is_of_z85(text);
}

Error cannot_be_opened(const std::filesystem::path& file, const char* why) {
    if (may_be_key(file.native()))
        return trouble("(not shown, as it may be a key)",
                       std::string(why) +
                           ". The name of a file is wanted: a secret that was given as an argument "
                           "is none any more, fraja-ctl keygen makes another one");
    return trouble(file, why);
}

/// systemd gives a service's user its credentials by an access list, which shows as its group's
/// rights, and root owns them.
bool is_credential(const std::filesystem::path& file) {
    const char* const folder = std::getenv("CREDENTIALS_DIRECTORY");
    return folder && *folder && file.parent_path() == std::filesystem::path(folder);
}

std::optional<Error> refusal(const std::filesystem::path& file, const struct stat& status) {
    const std::string name = file.string();
    if (!S_ISREG(status.st_mode))
        return trouble(file, "it is no file");
    if (status.st_uid != geteuid() && status.st_uid != 0)
        return trouble(file, "a secret that is somebody else's file: chown " +
                                 std::to_string(geteuid()) + " " + name + ", or have your own");
    const mode_t others = is_credential(file) ? S_IRWXO : S_IRWXG | S_IRWXO;
    if ((status.st_mode & others) != 0)
        return trouble(file, "others than its owner may read this secret: chmod 600 " + name);
    if (status.st_size > static_cast<off_t>(key_file_bytes_max))
        return trouble(file,
                       "a key file has at most " + std::to_string(key_file_bytes_max) + " bytes",
                       ErrorCode::limit_exceeded);
    return std::nullopt;
}

Result<void> read_all(const std::filesystem::path& path, File& file) {
    file.text.resize(key_file_bytes_max + 1);
    std::size_t size = 0;
    while (size < file.text.size()) {
        const ssize_t n = ::read(file.fd, file.text.data() + size, file.text.size() - size);
        if (n < 0 && errno == EINTR)
            continue;
        if (n < 0)
            return trouble(path, std::strerror(errno));
        if (n == 0)
            break;
        size += static_cast<std::size_t>(n);
    }
    file.text.resize(size);
    return {};
}

Result<KeyFile> read_table(const std::filesystem::path& path, toml::table& table) {
    KeyFile keys;
    const std::array<std::pair<const char*, std::string*>, 3> known = {
        {{"public", &keys.public_key}, {"secret", &keys.secret}, {"broker", &keys.broker}}};
    std::optional<Error> wrong;
    for (auto&& [key, node] : table) {
        const std::string name(key.str());
        const auto place = [&] {
            return path.string() + ":" + std::to_string(node.source().begin.line) + ": ";
        };
        const auto* const found =
            std::ranges::find_if(known, [&](const auto& entry) { return name == entry.first; });
        auto* const text = node.as_string();
        if (found == known.end())
            wrong = Error{ErrorCode::invalid_argument,
                          place() + "a key file has public, secret and broker, nothing else"};
        else if (!text)
            wrong = Error{ErrorCode::invalid_argument, place() + name + " is a text in quotes"};
        else
            *found->second = text->get();
        if (text)
            explicit_bzero(text->get().data(), text->get().size());
    }
    if (wrong)
        return *wrong;
    for (const auto& [name, text] : known)
        if (text->empty() && std::string_view(name) != "broker")
            return trouble(path,
                           std::string("it has no ") + name +
                               "; fraja-ctl keygen -o FILE makes a key file",
                           ErrorCode::invalid_argument);
    return keys;
}

} // namespace

KeyFile::~KeyFile() {
    explicit_bzero(secret.data(), secret.size());
}

/// A short string would leave a copy behind; a key is longer than those.
KeyFile::KeyFile(KeyFile&& other) noexcept
    : public_key(std::move(other.public_key)), broker(std::move(other.broker)),
      secret(std::move(other.secret)) {}

Result<KeyFile> read_key_file(const std::filesystem::path& path) {
    File file(::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK));
    if (file.fd < 0)
        return cannot_be_opened(path, std::strerror(errno));
    struct stat status {};
    if (fstat(file.fd, &status) != 0)
        return trouble(path, std::strerror(errno));
    if (auto refused = refusal(path, status))
        return *std::move(refused);
    if (const auto read = read_all(path, file); !read)
        return read.error();
    try {
        toml::table table = toml::parse(file.text, path.string());
        return read_table(path, table);
    } catch (const toml::parse_error& e) { // its words may quote the file
        return Error{ErrorCode::invalid_argument,
                     path.string() + ":" + std::to_string(e.source().begin.line) +
                         ": this is no TOML; fraja-ctl keygen -o FILE makes a key file"};
    }
}

Result<void> write_key_file(const std::filesystem::path& path, std::string_view public_key,
                            std::string_view secret, std::string_view broker) {
    File file(::open(path.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, S_IRUSR | S_IWUSR));
    if (file.fd < 0)
        return trouble(path, errno == EEXIST ? "is there already, and a key is never overwritten"
                                             : std::strerror(errno));
    // Single quotes: in TOML nothing in them means anything else, and no key has one.
    const auto add = [&](std::string_view text) { file.text.append(text); };
    add("# A key pair of Fraja. Whoever can read this file is taken for its owner.\npublic = '");
    add(public_key);
    add("'\nsecret = '");
    add(secret);
    add("'\n");
    if (!broker.empty()) {
        add("broker = '");
        add(broker);
        add("'\n");
    }
    std::string_view rest = file.text;
    while (!rest.empty()) {
        const ssize_t n = ::write(file.fd, rest.data(), rest.size());
        if (n < 0 && errno == EINTR)
            continue;
        if (n < 0) {
            const std::string why = std::strerror(errno);
            ::unlink(path.c_str());
            return trouble(path, why);
        }
        rest.remove_prefix(static_cast<std::size_t>(n));
    }
    if (fchmod(file.fd, S_IRUSR | S_IWUSR) != 0 || fsync(file.fd) != 0) {
        const std::string why = std::strerror(errno);
        ::unlink(path.c_str());
        return trouble(path, why);
    }
    return {};
}

} // namespace fraja::cli
