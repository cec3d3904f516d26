// What a contender shows to main.cpp: its functions, each over the same random states.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

namespace bench {

// Read from a file of 64-bit floats: joints, samples, size of beta, size of pi; then q of all samples, dq, ddq, tau;
// then beta and pi.
struct States {
    std::size_t joints, samples;
    std::vector<double> q, dq, ddq, tau, beta, pi;

    explicit States(const char *path);
};

// A function under test: `sweep` calls it once for every sample of a range; `result` evaluates one sample and
// returns its output, row by row.
struct Entry {
    std::string name;
    void (*sweep)(void *self, std::size_t begin, std::size_t end);
    std::vector<double> (*result)(void *self, std::size_t sample);
};

// Defined by each contender.
std::vector<Entry> list_entries();
void *open_contender(const States &states);

} // namespace bench

// An entry whose `call` may use the contender's Work as w and the sample as k; `output` is what it computed.
#define ENTRY(name, call, output)                                                                                \
    bench::Entry                                                                                                 \
    {                                                                                                            \
        name,                                                                                                    \
            [](void *self, std::size_t begin, std::size_t end) {                                                 \
                auto &w = *static_cast<Work *>(self);                                                            \
                for (std::size_t k = begin; k < end; ++k) {                                                      \
                    call;                                                                                        \
                }                                                                                                \
            },                                                                                                   \
            [](void *self, std::size_t k) -> std::vector<double> {                                               \
                auto &w = *static_cast<Work *>(self);                                                            \
                call;                                                                                            \
                return output;                                                                                   \
            }                                                                                                    \
    }
