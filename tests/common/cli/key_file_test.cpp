#include "common/cli/key_file.hpp"

#include <doctest/doctest.h>
#include <filesystem>
#include <fstream>
#include <string>
#include <sys/stat.h>
#include <unistd.h>

using namespace fraja;
using namespace fraja::cli;
namespace fs = std::filesystem;

namespace {

struct KeyFolder {
    fs::path path = fs::temp_directory_path() / ("fraja-keys-" + std::to_string(getpid()));
    KeyFolder() { fs::create_directory(path); }
    ~KeyFolder() { fs::remove_all(path); }
};

const std::string secret = "s3cret-s3cret-s3cret-s3cret-s3cret-s3cre";

} // namespace

TEST_CASE("a key file is made for its owner alone, read again, and never overwritten") {
    const KeyFolder folder;
    const fs::path file = folder.path / "key";
    const mode_t before = umask(0);
    REQUIRE(write_key_file(file, "public#$&", secret, "broker\\n").has_value());
    umask(before);
    struct stat status {};
    REQUIRE(stat(file.c_str(), &status) == 0);
    CHECK((status.st_mode & 07777) == 0600);
    const auto read = read_key_file(file);
    REQUIRE(read.has_value());
    CHECK(read->public_key == "public#$&");
    CHECK(read->secret == secret);
    CHECK(read->broker == "broker\\n");
    const auto refused = write_key_file(file, "p", "s", "");
    REQUIRE(!refused.has_value());
    CHECK(refused.error().message.find("never overwritten") != std::string::npos);
    CHECK(read_key_file(file)->secret == secret);
}

TEST_CASE("a key file that others may read is refused with the cure") {
    const KeyFolder folder;
    const fs::path file = folder.path / "key";
    REQUIRE(write_key_file(file, "p", secret, "").has_value());
    for (const mode_t mode : {0640u, 0604u, 0620u, 0660u, 0777u}) {
        CAPTURE(mode);
        REQUIRE(chmod(file.c_str(), mode) == 0);
        const auto refused = read_key_file(file);
        REQUIRE(!refused.has_value());
        CHECK(refused.error().message.find("chmod 600 " + file.string()) != std::string::npos);
    }
    // systemd's credentials show an access list as the group's rights.
    REQUIRE(chmod(file.c_str(), 0440) == 0);
    setenv("CREDENTIALS_DIRECTORY", folder.path.c_str(), 1);
    CHECK(read_key_file(file).has_value());
    REQUIRE(chmod(file.c_str(), 0444) == 0);
    CHECK(!read_key_file(file).has_value());
    unsetenv("CREDENTIALS_DIRECTORY");
    if (geteuid() == 0) { // only root can give files away
        REQUIRE(chmod(file.c_str(), 0600) == 0);
        REQUIRE(chown(file.c_str(), 12345, 12345) == 0);
        CHECK(read_key_file(file).error().message.find("somebody else's file") !=
              std::string::npos);
    }
}

TEST_CASE("a secret that is given in place of its file is not shown") {
    for (const std::string& given :
         {secret, std::string("q?9up[acLDlbOQ@[IS}37t%w<F[0GM&?g5BVzNLe"),
          std::string("//?9up[acLDlbOQ@[IS}37t%w<F[0GM&?g5BVzN/")}) {
        const auto refused = read_key_file(given);
        REQUIRE(!refused.has_value());
        CAPTURE(refused.error().message);
        CHECK(refused.error().message.find(given.substr(2, 20)) == std::string::npos);
        CHECK(refused.error().message.find("fraja-ctl keygen") != std::string::npos);
    }
    const auto missing = read_key_file("/no/such/file");
    REQUIRE(!missing.has_value());
    CHECK(missing.error().message.find("/no/such/file: ") != std::string::npos);
}

TEST_CASE("what is no key file is refused, and nothing in it is quoted") {
    const KeyFolder folder;
    const fs::path file = folder.path / "key";
    struct Row {
        std::string text, says;
    };
    for (const Row& row :
         {Row{"", "it has no public"}, Row{"public = 'p'\n", "it has no secret"},
          Row{"secret = " + secret, "key:1: this is no TOML"},
          Row{"public = 'p'\nsecret = '" + secret + "'\nmore = '" + secret + "'",
              "key:3: a key file has public, secret and broker"},
          Row{"public = 'p'\nsecret = ['" + secret + "']", "key:2: secret is a text in quotes"},
          Row{"public = 'p'\nsecret = '" + secret + "'\nsecret = '" + secret + "'", "no TOML"},
          Row{secret + std::string(key_file_bytes_max, '#'), "at most 16384 bytes"}}) {
        CAPTURE(row.says);
        std::ofstream(file) << row.text;
        REQUIRE(chmod(file.c_str(), 0600) == 0);
        const auto refused = read_key_file(file);
        REQUIRE(!refused.has_value());
        CHECK(refused.error().message.find(row.says) != std::string::npos);
        CHECK(refused.error().message.find(secret) == std::string::npos);
    }
    CHECK(!read_key_file(folder.path).has_value());
    CHECK(!read_key_file(folder.path / "none").has_value());
}
