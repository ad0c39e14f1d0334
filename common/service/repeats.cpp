#include "common/service/repeats.hpp"

#include <algorithm>
#include <utility>

namespace fraja::service {

bool Repeats::Tally::has_room(Instant now, const Allowance& allowance) const {
    return free_at <= now + (allowance.burst - 1) * allowance.interval;
}

void Repeats::Tally::use(Instant now, const Allowance& allowance) {
    free_at = std::max(free_at, now) + allowance.interval;
}

void Repeats::Tally::count(LogLine line) {
    ++untold;
    last = std::move(line);
}

Told Repeats::Tally::tell() {
    return {std::move(last), std::exchange(untold, 0) - 1}; // the last is told now
}

std::optional<Told> Repeats::take(Instant now, LogLine line) {
    if (line.kind.empty() || line.level == LogLevel::debug)
        return Told{std::move(line), 0};
    Kind& kind = kinds_[line.kind];
    if (!kind.all.has_room(now, limits_.kind)) {
        kind.all.count(std::move(line)); // its subject may be one of any number
        return std::nullopt;
    }
    Tally& subject = kind.subjects[line.subject];
    subject.count(std::move(line));
    if (!subject.has_room(now, limits_.subject))
        return std::nullopt;
    kind.all.use(now, limits_.kind);
    subject.use(now, limits_.subject);
    return subject.tell();
}

std::vector<Told> Repeats::due(Instant now) {
    std::vector<Told> told;
    for (auto& [name, kind] : kinds_) {
        const auto is_due = [&, &kind = kind](const Tally& tally) {
            return tally.untold > 0 && kind.all.has_room(now, limits_.kind);
        };
        if (is_due(kind.all)) {
            kind.all.use(now, limits_.kind);
            told.push_back(kind.all.tell());
        }
        for (auto& [subject, tally] : kind.subjects)
            if (is_due(tally) && tally.has_room(now, limits_.subject)) {
                kind.all.use(now, limits_.kind);
                tally.use(now, limits_.subject);
                told.push_back(tally.tell());
            }
        std::erase_if(kind.subjects, [now](const auto& entry) {
            return entry.second.untold == 0 && entry.second.free_at <= now;
        });
    }
    return told;
}

std::vector<Told> Repeats::rest() {
    std::vector<Told> told;
    for (auto& [name, kind] : kinds_) {
        if (kind.all.untold > 0)
            told.push_back(kind.all.tell());
        for (auto& [subject, tally] : kind.subjects)
            if (tally.untold > 0)
                told.push_back(tally.tell());
    }
    return told;
}

std::size_t Repeats::subject_count() const {
    std::size_t count = 0;
    for (const auto& [name, kind] : kinds_)
        count += kind.subjects.size();
    return count;
}

} // namespace fraja::service
