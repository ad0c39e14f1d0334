#include "common/service/journal.hpp"

#include <cstdlib>
#include <string>
#include <sys/stat.h>

namespace fraja::service {

bool goes_to_journal(int fd) {
    const char* const stream = std::getenv("JOURNAL_STREAM");
    struct stat file {};
    return stream && fstat(fd, &file) == 0 &&
           stream == std::to_string(file.st_dev) + ":" + std::to_string(file.st_ino);
}

std::string_view journal_prefix(LogLevel level) {
    switch (level) {
    case LogLevel::debug:
        return "<7>";
    case LogLevel::info:
        return "<6>";
    case LogLevel::warning:
        return "<4>";
    case LogLevel::error:
        break;
    }
    return "<3>";
}

} // namespace fraja::service
