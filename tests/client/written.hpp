// What a console says, to be read.
#pragma once

#include "client/console.hpp"

#include <cstdio>
#include <string>
#include <utility>

namespace fraja::client {

/// What a Console wrote into a file.
class Written {
public:
    explicit Written(ConsoleOptions options)
        : file_(std::tmpfile()), console(std::move(options), file_) {}
    ~Written() { std::fclose(file_); }
    Written(const Written&) = delete;
    Written& operator=(const Written&) = delete;
    [[nodiscard]] std::string text() {
        std::rewind(file_);
        std::string all(4096, '\0');
        all.resize(std::fread(all.data(), 1, all.size(), file_));
        return all;
    }

private:
    std::FILE* file_;

public:
    Console console;
};

} // namespace fraja::client
