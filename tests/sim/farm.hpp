// Farm: what all processes of a pretended farm share: time, chance, what is told in the end.
#pragma once

#include "common/base/ids.hpp"
#include "common/base/rng.hpp"
#include "common/protocol/messages.hpp"
#include "tests/sim/agenda.hpp"
#include "tests/sim/scenario.hpp"

#include <cmath>
#include <cstddef>
#include <map>
#include <optional>
#include <string>
#include <utility>

namespace fraja::sim {

struct Farm {
    explicit Farm(const Scenario& s) : scenario(s), rng(s.seed) {
        report.jobs.resize(s.jobs.size());
        report.workers.resize(s.workers.size());
    }

    const Scenario& scenario;
    Rng rng;
    Agenda agenda;
    Report report;

    /// What was submitted, and by which plan.
    struct Submitted {
        protocol::SubmitJob job;
        std::size_t plan = 0;
        Blob scene;
    };
    std::map<JobId, Submitted> submitted;
    std::map<ContentHash, std::size_t> plan_of_scene;

    [[nodiscard]] Instant now() const { return agenda.now(); }
    [[nodiscard]] bool healed() const { return now() >= Instant{} + scenario.faults.heals_at; }
    [[nodiscard]] const JobPlan& plan_of(const ContentHash& scene) const {
        return scenario.jobs[plan_of_scene.at(scene)];
    }

    template <class Id>
    [[nodiscard]] Id make_id() {
        Id id;
        for (std::uint8_t& byte : id.bytes)
            byte = static_cast<std::uint8_t>(rng.next());
        id.bytes[6] =
            static_cast<std::uint8_t>((id.bytes[6] & 0x0f) | 0x40); // as random_id() has it
        return id;
    }
    [[nodiscard]] Duration between(Duration low, Duration high) {
        return low + from_seconds(rng.unit() * seconds(high - low));
    }
    /// Of a message.
    [[nodiscard]] Duration delay() {
        return between(scenario.faults.delay_min, scenario.faults.delay_max);
    }
    /// Of a message: how long after it the same one comes again, if it does.
    [[nodiscard]] std::optional<Duration> duplicate_lag() {
        if (scenario.faults.duplicates <= 0 || healed() || rng.unit() >= scenario.faults.duplicates)
            return std::nullopt;
        ++report.duplicates;
        return rng.below(2) == 0 ? Duration::zero()
                                 : between(Duration::zero(), scenario.faults.duplicate_lag_max);
    }
    /// Does it again and again, with that mean time between, until all is healed.
    template <class F>
    void every(Duration mean, F deed) {
        if (mean <= Duration::zero())
            return;
        const Duration pause = from_seconds(-std::log(1 - rng.unit()) * seconds(mean));
        if (now() + pause >= Instant{} + scenario.faults.heals_at)
            return;
        agenda.after(pause, [this, mean, deed] {
            deed();
            every(mean, deed);
        });
    }

    void log(const std::string& what) const {
        if (scenario.on_log)
            scenario.on_log(now(), what);
    }
    /// What a broker says. A tile fails here only because its worker was lost or hangs, or hands it
    /// back when it leaves and a beat that comes twice says that it stays.
    void hear_broker(const std::string& name, const std::string& text) {
        log(name + ": " + text);
        if (text.find(" failed on ") == std::string::npos)
            return;
        for (const char* reason : {": the worker was lost", ": it traced no ray within the lease",
                                   ": this worker is leaving"})
            if (text.ends_with(reason))
                return;
        violation(name + " says: " + text);
    }
    void violation(std::string what) {
        report.violations.push_back(std::to_string(seconds(now().since_start)) +
                                    " s: " + std::move(what));
    }
    void note(std::uint64_t what) {
        ++report.events;
        report.history =
            Rng(report.history ^ what ^ static_cast<std::uint64_t>(now().since_start.count()))
                .next();
    }
};

} // namespace fraja::sim
