// A clock around the functions of a contender, instruction counts, and results for the check.
//
// Called as: PROGRAM STATES list | time FUNCTION MILLISECONDS | check FUNCTION FILE | count FUNCTION...
#include "contender.hpp"

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <time.h>

#if __has_include(<valgrind/callgrind.h>)
#include <valgrind/callgrind.h>
#else
#define CALLGRIND_ZERO_STATS
#define CALLGRIND_DUMP_STATS_AT(name)
#endif

namespace bench {

namespace {

[[noreturn]] void fail(const char *what, const char *why)
{
    std::fprintf(stderr, "%s: %s\n", what, why);
    std::exit(2);
}

void read(std::FILE *file, std::vector<double> &part, std::size_t size, const char *path)
{
    part.resize(size);
    if (std::fread(part.data(), sizeof(double), size, file) != size) {
        fail(path, "ends early");
    }
}

const Entry &find(const std::vector<Entry> &entries, const char *name)
{
    const auto found =
        std::find_if(entries.begin(), entries.end(), [name](const Entry &entry) { return entry.name == name; });
    if (found == entries.end()) {
        fail(name, "no such function");
    }
    return *found;
}

// Processor time of this thread: what runs beside it on the same core does not count.
double read_clock()
{
    timespec now = {};
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
    return 1e9 * static_cast<double>(now.tv_sec) + static_cast<double>(now.tv_nsec);
}

// Nanoseconds a sample: the median of sweeps over all samples.
double clock_sweeps(const Entry &entry, void *self, std::size_t samples, double milliseconds)
{
    std::vector<double> sweeps;
    double spent = 0;
    entry.sweep(self, 0, samples);
    while (spent < 1e6 * milliseconds || sweeps.size() < 5) {
        const double start = read_clock();
        entry.sweep(self, 0, samples);
        const double taken = read_clock() - start;
        spent += taken;
        sweeps.push_back(taken / static_cast<double>(samples));
    }
    const auto middle = sweeps.begin() + static_cast<std::ptrdiff_t>(sweeps.size() / 2);
    std::nth_element(sweeps.begin(), middle, sweeps.end());
    return *middle;
}

void write_results(const Entry &entry, void *self, std::size_t samples, const char *path)
{
    std::FILE *file = std::fopen(path, "wb");
    if (file == nullptr) {
        fail(path, "cannot be written");
    }
    for (std::size_t k = 0; k < samples; ++k) {
        const auto values = entry.result(self, k);
        std::fwrite(values.data(), sizeof(double), values.size(), file);
    }
    if (std::fclose(file) != 0) {
        fail(path, "cannot be written");
    }
}

} // namespace

States::States(const char *path)
{
    std::FILE *file = std::fopen(path, "rb");
    if (file == nullptr) {
        fail(path, "cannot be read");
    }
    std::vector<double> head;
    read(file, head, 4, path);
    joints = static_cast<std::size_t>(head[0]);
    samples = static_cast<std::size_t>(head[1]);
    for (auto *part : {&q, &dq, &ddq, &tau}) {
        read(file, *part, joints * samples, path);
    }
    read(file, beta, static_cast<std::size_t>(head[2]), path);
    read(file, pi, static_cast<std::size_t>(head[3]), path);
    std::fclose(file);
}

} // namespace bench

int main(int argc, char **argv)
{
    const std::string mode = argc > 2 ? argv[2] : "";
    const bool fits = mode == "list" || (mode == "count" && argc > 3) || ((mode == "time" || mode == "check") && argc == 5);
    if (!fits) {
        bench::fail(argv[0], "STATES list | time FUNCTION MILLISECONDS | check FUNCTION FILE | count FUNCTION...");
    }
    const auto entries = bench::list_entries();
    const bench::States states(argv[1]);
    void *self = bench::open_contender(states);
    if (mode == "list") {
        for (const auto &entry : entries) {
            std::puts(entry.name.c_str());
        }
    } else if (mode == "time") {
        const auto &entry = bench::find(entries, argv[3]);
        std::printf("%.3f\n", bench::clock_sweeps(entry, self, states.samples, std::atof(argv[4])));
    } else if (mode == "check") {
        bench::write_results(bench::find(entries, argv[3]), self, states.samples, argv[4]);
    } else if (mode == "count") {
        for (int k = 3; k < argc; ++k) {
            const auto &entry = bench::find(entries, argv[k]);
            // The first sweep binds the functions of the C library.
            entry.sweep(self, 0, states.samples);
            CALLGRIND_ZERO_STATS;
            entry.sweep(self, 0, states.samples);
            CALLGRIND_DUMP_STATS_AT(entry.name.c_str());
        }
    }
    return 0;
}
