#include "broker/metrics.hpp"

#include "common/base/version.hpp"

#include <initializer_list>
#include <prometheus/text_serializer.h>
#include <string_view>
#include <utility>
#include <vector>

namespace fraja::broker {
namespace {

using prometheus::MetricType;

struct Series {
    std::vector<prometheus::ClientMetric::Label> labels;
    double value = 0;
};

/// One series for each value of a label.
struct Labelled {
    const char* value;
    std::uint64_t count;
};

class Families {
public:
    explicit Families(std::string prefix) : prefix_(std::move(prefix)) {}

    void gauge(const char* name, const char* help, double value) {
        add(MetricType::Gauge, name, help, {{{}, value}});
    }
    void gauge(const char* name, const char* help, std::uint64_t value) {
        gauge(name, help, static_cast<double>(value));
    }
    void counter(const char* name, const char* help, double value) {
        add(MetricType::Counter, name, help, {{{}, value}});
    }
    void counter(const char* name, const char* help, std::uint64_t value) {
        counter(name, help, static_cast<double>(value));
    }
    void gauges(const char* name, const char* help, const char* label,
                std::initializer_list<Labelled> values) {
        add(MetricType::Gauge, name, help, labelled(label, values));
    }
    void counters(const char* name, const char* help, const char* label,
                  std::initializer_list<Labelled> values) {
        add(MetricType::Counter, name, help, labelled(label, values));
    }
    void add(MetricType type, const char* name, const char* help, std::vector<Series> series) {
        prometheus::MetricFamily family{prefix_ + name, help, type, {}};
        for (Series& s : series) {
            prometheus::ClientMetric& metric = family.metric.emplace_back();
            metric.label = std::move(s.labels);
            (type == MetricType::Counter ? metric.counter.value : metric.gauge.value) = s.value;
        }
        families_.push_back(std::move(family));
    }
    [[nodiscard]] std::string text() const {
        return prometheus::TextSerializer{}.Serialize(families_);
    }

private:
    static std::vector<Series> labelled(const char* label, std::initializer_list<Labelled> values) {
        std::vector<Series> series;
        for (const Labelled& v : values)
            series.push_back({{{label, v.value}}, static_cast<double>(v.count)});
        return series;
    }

    std::string prefix_;
    std::vector<prometheus::MetricFamily> families_;
};

void add_workers(Families& all, const Figures& f) {
    all.gauges("workers", "Workers that are here, by what they are at.", "state",
               {{"idle", f.workers_idle},
                {"busy", f.workers_busy},
                {"draining", f.workers_draining},
                {"quarantined", f.workers_quarantined},
                {"distrusted", f.workers_distrusted}});
    all.gauge("threads", "Render threads of the workers that may be given tiles.", f.threads);
    all.gauge("credit_tiles", "Tiles that the workers take at once, in all.", f.credit);
    all.counter("workers_welcomed_total", "Hellos of workers that were welcomed.",
                f.counters.workers_welcomed);
    all.counter("workers_lost_total", "Workers that were lost without a goodbye.",
                f.counters.workers_lost);
    all.counter("workers_quarantined_total", "Times that a worker had failed too often.",
                f.counters.workers_quarantined);
    all.counter("workers_distrusted_total", "Workers that were found to answer wrong pixels.",
                f.counters.workers_distrusted);
}

void add_brokers(Families& all, const Figures& f) {
    all.gauge("epoch", "Number of the term in which tiles are handed out; larger than all before.",
              f.term);
    all.gauge("leads", "1 while this broker hands out the tiles.", std::uint64_t{f.leads});
    all.gauges("brokers", "Brokers that stand for each other, by whether they are heard.", "state",
               {{"here", f.brokers_here}, {"gone", f.brokers_gone}});
    all.gauge("jobs_lacking_copies", "Jobs, not over, that some broker does not have, or is gone.",
              f.jobs_lacking_copies);
}

void add_jobs(Families& all, const Figures& f) {
    using protocol::JobPhase;
    const auto count = [&](JobPhase phase) { return f.jobs[static_cast<std::size_t>(phase)]; };
    all.gauges("jobs", "Jobs that are known, by phase.", "phase",
               {{"waiting_for_scene", count(JobPhase::waiting_for_scene)},
                {"queued", count(JobPhase::queued)},
                {"running", count(JobPhase::running)},
                {"paused", count(JobPhase::paused)},
                {"done", count(JobPhase::done)},
                {"failed", count(JobPhase::failed)},
                {"cancelled", count(JobPhase::cancelled)}});
    all.gauge("jobs_ready", "Jobs that have tiles to give to whoever has room.", f.jobs_ready);
    all.gauge("cells_left", "Cells of queued and running jobs that are not done.", f.cells_left);
    all.gauge("work_left_thread_seconds",
              "Time that one render thread would take for what is left, as far as can be told; 0 "
              "until the first tile is done.",
              f.work_left_s);
    all.counter("jobs_acknowledged_total", "Jobs that were taken on, or were tried again.",
                f.counters.jobs_acknowledged);
    all.counters("jobs_ended_total", "Jobs that ended, by how.", "outcome",
                 {{"done", f.counters.jobs_done},
                  {"failed", f.counters.jobs_failed},
                  {"cancelled", f.counters.jobs_cancelled}});
}

void add_tiles(Families& all, const Figures& f) {
    const Counters& c = f.counters;
    all.gauge("tiles_in_flight", "Tiles at workers, probes included.", f.tiles_in_flight);
    all.counter("tiles_sent_total", "Tiles and probes given to workers, repetitions included.",
                c.tiles_sent);
    all.counter("tiles_done_total", "Tiles that came back and were taken.", c.tiles_done);
    all.counter("tiles_requeued_total", "Tiles taken back to be given to somebody else.",
                c.tiles_requeued);
    all.counter("tiles_failed_total", "Failures that count against their tile.", c.tiles_failed);
    all.counter("tiles_overbooked_total", "Tiles given out once more as they took long.",
                c.tiles_overbooked);
    all.counter("tiles_duplicated_total", "Answers that came after somebody else's.",
                c.answers_unneeded);
    all.counter("tiles_checked_total", "Tiles that two workers drew, and both the same.",
                c.tiles_checked);
    all.counter("tiles_unchecked_total",
                "Tiles that were to be checked, and for which there was no second worker.",
                c.tiles_unchecked);
    all.counter("tiles_distrusted_total", "Answers of workers that are distrusted.",
                c.answers_distrusted);
    all.counter("tiles_stale_total", "Answers that nobody waited for.", c.stale_answers);
    all.counters("rays_total", "Rays traced for the tiles that are done, by kind.", "kind",
                 {{"camera", c.rays.camera},
                  {"reflected", c.rays.reflected},
                  {"refracted", c.rays.refracted},
                  {"shadow", c.rays.shadow}});
    all.counter("render_seconds_total", "Time that render threads took for the tiles done.",
                seconds(c.render_time));
}

void add_peers(Families& all, const Report& r) {
    const Counters& c = r.figures.counters;
    all.gauge("clients", "Clients that are here.", r.figures.clients);
    all.gauge("jobs_watched", "Jobs whose stream has a subscriber.", r.figures.jobs_watched);
    all.counter("peers_refused_total", "Hellos of workers and clients that were refused.",
                c.peers_refused);
    all.counters("messages_refused_total", "Messages that were refused, by why.", "reason",
                 {{"malformed", c.rubbish},
                  {"version", c.wrong_version},
                  {"unexpected", c.unexpected},
                  {"not_allowed", c.not_allowed}});
    all.counter("keys_refused_total", "Handshakes that were refused over their key.",
                r.keys_refused);
    all.counter("keys_missing_total", "Handshakes that ended before a key was shown.",
                r.keys_missing);
    all.counter("received_bytes_total", "Messages from workers and clients.", r.received_bytes);
    all.counter("sent_bytes_total", "Messages to workers and clients.", r.sent_bytes);
    all.counter("published_bytes_total", "Messages of the stream, once for all subscribers.",
                r.published_bytes);
}

void add_store(Families& all, const Report& r, const std::optional<StoreUsage>& usage) {
    all.gauge("scene_bytes", "Scenes in memory, arrived and announced.", r.figures.scene_bytes);
    if (!r.written)
        return;
    all.gauge("store_failing", "1 while nothing can be written to the store.",
              std::uint64_t{!r.figures.store_trouble.empty()});
    all.gauge("store_paused", "1 while no tiles are handed out, as the store is behind or fails.",
              std::uint64_t{r.figures.store_is_behind});
    all.gauge("store_queued_bytes", "What is on its way to the store.", r.figures.unstored_bytes);
    all.counter("store_commits_total", "Transactions written to the store.", r.written->commits);
    all.counter("store_failed_commits_total", "Transactions that could not be written.",
                r.written->failed_commits);
    all.counter("store_written_bytes_total", "What was written to the store.", r.written->bytes);
    if (!usage)
        return;
    all.gauge("store_bytes", "Size of the store's files.", usage->bytes);
    all.gauge("store_free_bytes", "Room that is left on the store's disk.", usage->free_bytes);
}

/// By the names that every program has for these.
std::string process_text(const ProcessUsage& p) {
    Families all("process_");
    all.counter("cpu_seconds_total", "Processor time of the process.", p.cpu_s);
    all.gauge("resident_memory_bytes", "Resident memory of the process.", p.resident_bytes);
    all.gauge("open_fds", "Open file descriptors.", p.open_fds);
    all.gauge("max_fds", "File descriptors that the process may have.", p.max_fds);
    all.gauge("start_time_seconds", "Start of the process, since 1970.", p.started_at_s);
    return all.text();
}

} // namespace

std::string metrics_text(const MetricSources& sources) {
    Families all("fraja_broker_");
    all.add(MetricType::Gauge, "info", "1, with the program's version and git revision.",
            {{{{"version", std::string(version)}, {"revision", std::string(revision())}}, 1}});
    if (const Report* report = sources.report) {
        add_brokers(all, report->figures);
        add_workers(all, report->figures);
        add_jobs(all, report->figures);
        add_tiles(all, report->figures);
        add_peers(all, *report);
        add_store(all, *report, sources.store);
    }
    return all.text() + process_text(sources.process);
}

} // namespace fraja::broker
