// The keys of a farm for tests: made by fraja-ctl keygen, as people make them.
#pragma once

#include "tests/e2e/farm.hpp"

#include <doctest/doctest.h>
#include <fstream>
#include <map>
#include <string>

namespace fraja::e2e {

/// The keys of a farm's people, made as they make them.
class Ring {
public:
    Ring() {
        farm_ = make("farm", {});
        for (const char* name : {"worker", "second", "branch", "ada", "eve", "stranger"})
            keys_[name] = make(name, {"--broker-key", farm_});
    }
    [[nodiscard]] std::string file(const std::string& name) const {
        return scratch_.file(name + ".key");
    }
    [[nodiscard]] std::string allow_file() const { return scratch_.file("allow"); }
    [[nodiscard]] std::string scratch(const std::string& name) const { return scratch_.file(name); }
    /// The public one.
    [[nodiscard]] const std::string& key(const std::string& name) const {
        return name == "farm" ? farm_ : keys_.at(name);
    }
    void allow(const std::map<std::string, std::string>& roles,
               const std::string& file_name = "allow") const {
        std::ofstream out(scratch_.file(file_name));
        for (const auto& [name, role] : roles)
            out << role << ' ' << key(name) << ' ' << name << '\n';
    }
    [[nodiscard]] Words farm_options() const {
        return {"--key-file", file("farm"), "--allow", allow_file()};
    }
    [[nodiscard]] Words broker_options() const {
        return with({"--heartbeat", heartbeat_option}, farm_options());
    }
    [[nodiscard]] std::string secret(const std::string& name) const {
        std::ifstream in(file(name));
        for (std::string line; std::getline(in, line);)
            if (line.starts_with("secret = '"))
                return line.substr(10, 40);
        FAIL("no secret");
        return {};
    }

private:
    std::string make(const std::string& name, const Words& options) const {
        const auto made =
            run({with({program("fraja-ctl"), "keygen", "-o", file(name)}, options)}, patience);
        REQUIRE(made.has_value());
        REQUIRE(made->exit == 0);
        REQUIRE(made->out.size() == 41);
        return made->out.substr(0, 40);
    }

    Scratch scratch_;
    std::string farm_;
    std::map<std::string, std::string> keys_;
};

} // namespace fraja::e2e
