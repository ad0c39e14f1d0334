#include "common/base/allowance.hpp"

#include <algorithm>
#include <doctest/doctest.h>
#include <map>
#include <sched.h>
#include <string>
#include <thread>

using namespace fraja;

namespace {

using Files = std::map<std::string, std::string>;

FileReader reader(const Files& files) {
    return [&files](const std::string& path) -> std::optional<std::string> {
        const auto found = files.find(path);
        return found == files.end() ? std::nullopt : std::optional(found->second);
    };
}

// As they were read on machines, but for other mounts.

/// systemd 252, cgroups of version 2: a service in a slice.
const Files service_v2 = {
    {"/proc/self/cgroup", "0::/system.slice/fraja-worker.service\n"},
    {"/proc/self/mountinfo",
     "22 27 0:20 / /proc rw,nosuid,nodev,noexec,relatime shared:12 - proc proc rw\n"
     "29 23 0:25 / /sys/fs/cgroup rw,nosuid,nodev,noexec,relatime shared:4 - cgroup2 cgroup2 "
     "rw,nsdelegate,memory_recursiveprot\n"},
    {"/sys/fs/cgroup/system.slice/cpu.max", "max 100000\n"},
    {"/sys/fs/cgroup/system.slice/memory.max", "8589934592\n"},
    {"/sys/fs/cgroup/system.slice/fraja-worker.service/cpu.max", "150000 100000\n"},
    {"/sys/fs/cgroup/system.slice/fraja-worker.service/memory.max", "max\n"},
};

/// A container with a namespace of its own: it sees its group as the top.
const Files container_v2 = {
    {"/proc/self/cgroup", "0::/\n"},
    {"/proc/self/mountinfo",
     "1460 1459 0:26 / /sys/fs/cgroup ro,nosuid,nodev,noexec,relatime - cgroup2 cgroup rw\n"},
    {"/sys/fs/cgroup/cpu.max", "250000 50000\n"},
    {"/sys/fs/cgroup/memory.max", "536870912\n"},
};

/// A pod on a machine with cgroups of version 1: its mounts show its own group as the top, and its
/// groups are called as outside.
const Files pod_v1 = {
    {"/proc/self/cgroup", "11:cpu,cpuacct:/kubepods/burstable/pod7c/f00\n"
                          "9:memory:/kubepods/burstable/pod7c/f00\n"
                          "1:name=systemd:/kubepods/burstable/pod7c/f00\n"},
    {"/proc/self/mountinfo",
     "903 902 0:29 /kubepods/burstable/pod7c/f00 /sys/fs/cgroup/systemd ro - cgroup cgroup "
     "rw,xattr,name=systemd\n"
     "911 902 0:35 /kubepods/burstable/pod7c/f00 /sys/fs/cgroup/cpu,cpuacct ro,nosuid master:18 - "
     "cgroup cgroup rw,cpu,cpuacct\n"
     "913 902 0:37 /kubepods/burstable/pod7c/f00 /sys/fs/cgroup/memory ro,nosuid master:20 - "
     "cgroup cgroup rw,memory\n"},
    {"/sys/fs/cgroup/cpu,cpuacct/cpu.cfs_quota_us", "400000\n"},
    {"/sys/fs/cgroup/cpu,cpuacct/cpu.cfs_period_us", "100000\n"},
    {"/sys/fs/cgroup/memory/memory.limit_in_bytes", "2147483648\n"},
};

/// A step of a Slurm job: what limits it stands two groups above it.
const Files slurm_v1 = {
    {"/proc/self/cgroup", "5:cpuset:/slurm/uid_1000/job_17/step_0\n"
                          "4:memory:/slurm/uid_1000/job_17/step_0\n"
                          "2:cpu:/slurm/uid_1000/job_17/step_0\n"
                          "0::/user.slice\n"},
    {"/proc/self/mountinfo", "30 25 0:26 / /sys/fs/cgroup/unified rw - cgroup2 cgroup2 rw\n"
                             "33 25 0:29 / /sys/fs/cgroup/cpu rw - cgroup cgroup rw,cpu\n"
                             "36 25 0:32 / /sys/fs/cgroup/memory rw - cgroup cgroup rw,memory\n"},
    {"/sys/fs/cgroup/cpu/cpu.cfs_quota_us", "-1\n"},
    {"/sys/fs/cgroup/cpu/cpu.cfs_period_us", "100000\n"},
    {"/sys/fs/cgroup/cpu/slurm/uid_1000/cpu.cfs_quota_us", "800000\n"},
    {"/sys/fs/cgroup/cpu/slurm/uid_1000/cpu.cfs_period_us", "100000\n"},
    {"/sys/fs/cgroup/cpu/slurm/uid_1000/job_17/cpu.cfs_quota_us", "300000\n"},
    {"/sys/fs/cgroup/cpu/slurm/uid_1000/job_17/cpu.cfs_period_us", "100000\n"},
    {"/sys/fs/cgroup/cpu/slurm/uid_1000/job_17/step_0/cpu.cfs_quota_us", "-1\n"},
    {"/sys/fs/cgroup/cpu/slurm/uid_1000/job_17/step_0/cpu.cfs_period_us", "100000\n"},
    {"/sys/fs/cgroup/memory/memory.limit_in_bytes", "9223372036854771712\n"},
    {"/sys/fs/cgroup/memory/slurm/uid_1000/job_17/memory.limit_in_bytes", "4294967296\n"},
    {"/sys/fs/cgroup/memory/slurm/uid_1000/job_17/step_0/memory.limit_in_bytes",
     "9223372036854771712\n"},
};

Files with(Files files, const std::string& path, const std::string& text) {
    files[path] = text;
    return files;
}

} // namespace

TEST_CASE("the tightest limit of a process's control groups and all above them counts") {
    struct Row {
        const char* where;
        Files files;
        std::optional<GroupLimit> cpu, memory;
    };
    const std::string service = "/sys/fs/cgroup/system.slice/fraja-worker.service/cpu.max";
    const std::string job = "slurm/uid_1000/job_17/";
    for (const Row& row : {
             Row{"a service", service_v2, GroupLimit{1.5, service},
                 GroupLimit{8589934592, "/sys/fs/cgroup/system.slice/memory.max"}},
             Row{"a slice that has less than its service",
                 with(service_v2, "/sys/fs/cgroup/system.slice/cpu.max", "50000 100000\n"),
                 GroupLimit{.5, "/sys/fs/cgroup/system.slice/cpu.max"},
                 GroupLimit{8589934592, "/sys/fs/cgroup/system.slice/memory.max"}},
             Row{"a container", container_v2, GroupLimit{5, "/sys/fs/cgroup/cpu.max"},
                 GroupLimit{536870912, "/sys/fs/cgroup/memory.max"}},
             Row{"a pod", pod_v1, GroupLimit{4, "/sys/fs/cgroup/cpu,cpuacct/cpu.cfs_quota_us"},
                 GroupLimit{2147483648, "/sys/fs/cgroup/memory/memory.limit_in_bytes"}},
             Row{"a step", slurm_v1,
                 GroupLimit{3, "/sys/fs/cgroup/cpu/" + job + "cpu.cfs_quota_us"},
                 GroupLimit{4294967296, "/sys/fs/cgroup/memory/" + job + "memory.limit_in_bytes"}},
             Row{"a container whose group is called otherwise outside",
                 with(container_v2, "/proc/self/mountinfo",
                      "1460 1459 0:26 /docker/4711 /sys/fs/cgroup ro - cgroup2 cgroup rw\n"),
                 GroupLimit{5, "/sys/fs/cgroup/cpu.max"},
                 GroupLimit{536870912, "/sys/fs/cgroup/memory.max"}},
             Row{"a hierarchy that is also seen from another group on",
                 with(service_v2, "/proc/self/mountinfo",
                      "28 23 0:25 /other /mnt rw - cgroup2 cgroup2 rw\n" +
                          service_v2.at("/proc/self/mountinfo")),
                 GroupLimit{1.5, service},
                 GroupLimit{8589934592, "/sys/fs/cgroup/system.slice/memory.max"}},
         }) {
        CAPTURE(row.where);
        CHECK(cpu_limit(reader(row.files)) == row.cpu);
        CHECK(memory_limit(reader(row.files)) == row.memory);
    }
}

TEST_CASE("a mount's name may have spaces") {
    const Files files = {
        {"/proc/self/cgroup", "0::/a\n"},
        {"/proc/self/mountinfo", "29 23 0:25 / /mnt/my\\040groups rw - cgroup2 cgroup2 rw\n"},
        {"/mnt/my groups/a/cpu.max", "200000 100000\n"},
    };
    CHECK(cpu_limit(reader(files)) == GroupLimit{2, "/mnt/my groups/a/cpu.max"});
}

TEST_CASE("what does not read as a limit is none") {
    CHECK_FALSE(cpu_limit(reader({})));
    CHECK_FALSE(memory_limit(reader({})));
    for (const char* text : {"", "max 100000\n", "max", "100000", "0 100000\n", "-1 100000\n",
                             "100000 0\n", "nan 100000\n", "1e9 100000\n", " \n", "\n"}) {
        CAPTURE(text);
        CHECK_FALSE(cpu_limit(reader(with(container_v2, "/sys/fs/cgroup/cpu.max", text))));
    }
    for (const char* text : {"", "max\n", "0\n", "-1\n", "lots\n"}) {
        CAPTURE(text);
        CHECK_FALSE(memory_limit(reader(with(container_v2, "/sys/fs/cgroup/memory.max", text))));
    }
    for (const char* line : {"", "0", "0::", ":::", "0:/", "0::..\n"}) {
        CAPTURE(line);
        (void)cpu_limit(reader(with(container_v2, "/proc/self/cgroup", line)));
    }
    for (const char* line : {"", " - ", "1 2 3 - cgroup2", " -  - cgroup2 x rw"}) {
        CAPTURE(line);
        (void)cpu_limit(reader(with(container_v2, "/proc/self/mountinfo", line)));
    }
}

TEST_CASE("as many threads as the affinity mask has processors and the quota keeps busy") {
    struct Row {
        std::uint32_t machine, affinity;
        std::optional<double> quota;
        std::uint32_t usable;
        std::string limit;
    };
    for (const Row& row : {
             Row{64, 64, {}, 64, ""},
             Row{64, 8, {}, 8, "its affinity mask has 8 of 64 processors"},
             Row{64, 64, 1.5, 2, "FILE allows 1.5 of 64 processors"},
             Row{64, 8, 2.0, 2, "FILE allows 2 of 64 processors"},
             Row{64, 2, 8.0, 2, "its affinity mask has 2 of 64 processors"},
             Row{64, 2, 2.0, 2, "its affinity mask has 2 of 64 processors"},
             Row{2, 2, 1.5, 2, ""},
             Row{2, 2, .01, 1, "FILE allows 0.01 of 2 processors"},
             Row{1, 1, .5, 1, ""},
             Row{1, 0, {}, 1, ""},
         }) {
        CAPTURE(row.limit);
        const Processors found = processors_within(
            row.machine, row.affinity,
            row.quota ? std::optional(GroupLimit{*row.quota, "FILE"}) : std::nullopt);
        CHECK(found.usable == row.usable);
        CHECK(found.machine == row.machine);
        CHECK(found.limit == row.limit);
    }
}

TEST_CASE("the affinity mask of this very thread is looked at") {
    std::thread([] {
        cpu_set_t all;
        REQUIRE(sched_getaffinity(0, sizeof all, &all) == 0);
        cpu_set_t one;
        CPU_ZERO(&one);
        for (std::size_t i = 0; CPU_COUNT(&one) == 0; ++i)
            if (CPU_ISSET(i, &all))
                CPU_SET(i, &one);
        REQUIRE(sched_setaffinity(0, sizeof one, &one) == 0);
        const Processors found = usable_processors();
        CHECK(found.usable == 1);
        CHECK((found.machine == 1 || !found.limit.empty()));
    }).join();
}
