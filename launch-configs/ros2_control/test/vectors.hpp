// Reads the test vectors of `mr-damper export --vectors`: the readings, and what the service computes from them.
#pragma once

#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <map>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

#include "mr_damper_controller/core.hpp"

namespace mr_damper_controller {

// One line of the file. What the file does not have is NaN.
struct Vector {
  std::int64_t time_ns = 0;
  Readings readings{};
  bool is_accepted = false;
  std::uint32_t flags = 0;
  double force_n = kNaN;
  bool has_reading = false;  // the file has a column reading_n
  double reading_n = kNaN;
  bool is_commanded = false;
  double command_a = kNaN, expected_n = kNaN, least_n = kNaN, most_n = kNaN, limited_by = kNaN;
};

// The same bits; all NaN are equal.
inline bool is_same(double a, double b) {
  return (std::isnan(a) && std::isnan(b)) || std::memcmp(&a, &b, sizeof a) == 0;
}

inline std::vector<std::string> cells_of(const std::string& line) {
  std::vector<std::string> cells;
  std::stringstream stream(line);
  for (std::string cell; std::getline(stream, cell, ',');) cells.push_back(cell);
  if (!line.empty() && line.back() == ',') cells.emplace_back();
  return cells;
}

inline std::vector<Vector> read_vectors(const std::string& path) {
  std::ifstream file(path);
  std::string line;
  if (!std::getline(file, line)) throw std::runtime_error(path + " cannot be read, or is empty");
  std::map<std::string, std::size_t> columns;
  const auto names = cells_of(line);
  for (std::size_t k = 0; k < names.size(); ++k) columns[names[k]] = k;
  std::vector<Vector> all;
  while (std::getline(file, line)) {
    const auto cells = cells_of(line);
    if (cells.size() != names.size()) throw std::runtime_error(path + ": a line has another number of cells: " + line);
    const auto number = [&](const char* name) {
      const auto found = columns.find(name);
      if (found == columns.end() || cells[found->second].empty()) return kNaN;
      char* end = nullptr;
      const double value = std::strtod(cells[found->second].c_str(), &end);
      if (*end != '\0') throw std::runtime_error(path + ": not a number: " + cells[found->second]);
      return value;
    };
    Vector own;
    own.time_ns = std::stoll(cells.at(columns.at("time_ns")));
    own.readings = {number("displacement_m"), number("current_a"), number("command_v"),
                    number("velocity_m_s"), number("case_temp_c"), number("force_request_n")};
    own.is_accepted = cells.at(columns.at("accepted")) == "1";
    own.flags = static_cast<std::uint32_t>(std::stoul(cells.at(columns.at("flags"))));
    own.force_n = number("force_n");
    own.has_reading = columns.count("reading_n") != 0;
    own.reading_n = number("reading_n");
    own.command_a = number("command_a");
    own.is_commanded = !std::isnan(own.command_a);
    own.expected_n = number("expected_n");
    own.least_n = number("least_n");
    own.most_n = number("most_n");
    own.limited_by = number("limited_by");
    all.push_back(own);
  }
  return all;
}

// How often the service's line had each property, so that a test can demand that its vectors have all of them.
struct Seen {
  int forces = 0, refused = 0, stale = 0, extrapolating = 0, degraded = 0, valid = 0, invalid = 0, commands = 0, limited = 0;
};

// The reason why the values of one sample are not those of the service, or "". `last_a` is the last command.
inline std::string difference(const Vector& wanted, const Values& values, Seen& seen, double& last_a) {
  const double force_n = wanted.is_accepted ? wanted.force_n : kNaN;
  if (!is_same(values[kForce], force_n)) return "force";
  seen.forces += std::isfinite(force_n) ? 1 : 0;
  seen.refused += wanted.is_accepted ? 0 : 1;
  // A load cell's reading needs a force, and is empty in the file where the service has no residual.
  if (wanted.is_accepted && wanted.has_reading && !std::isnan(wanted.reading_n) && !is_same(values[kForceReading], wanted.reading_n)) {
    return "force_reading";
  }
  if (!wanted.is_accepted && !std::isnan(values[kForceReading])) return "force_reading of a refused displacement";
  // Flags of a refused line do not count.
  if (wanted.is_accepted && values[kReasons] != wanted.flags) return "reasons";
  // The table of model/src/pipeline/event.rs, by the values of the bits in ForceEstimate.msg.
  double validity = wanted.flags == 0 ? 0.0 : 1.0;
  if ((wanted.flags & 32U) != 0U) validity = 2.0;
  if ((wanted.flags & 2U) != 0U) validity = 3.0;
  if ((wanted.flags & (1U | 8192U)) != 0U || std::isnan(force_n)) validity = 4.0;
  if (values[kValidity] != validity) return "validity";
  int* const counts[] = {&seen.valid, &seen.degraded, &seen.extrapolating, &seen.stale, &seen.invalid};
  ++*counts[static_cast<int>(validity)];
  if (values[kMode] != (std::isnan(force_n) ? 4.0 : 2.0)) return "mode";
  if (!kHasInverse) return std::isnan(values[kCurrentCommand]) ? "" : "current_command without an inverse controller";
  if (!std::isfinite(values[kCurrentCommand])) return "current_command is not finite";
  if (!wanted.is_commanded) {
    // Before the first command the safe current; later the one before, or less far from the safe one (0 A).
    return values[kCurrentCommand] <= last_a && values[kCurrentCommand] >= 0.0 ? "" : "current_command rises without a command";
  }
  ++seen.commands;
  seen.limited += wanted.limited_by != 0.0 ? 1 : 0;
  last_a = wanted.command_a;
  if (!is_same(values[kCurrentCommand], wanted.command_a)) return "current_command";
  if (!is_same(values[kForceExpected], wanted.expected_n)) return "force_expected";
  if (!is_same(values[kForceLeast], wanted.least_n) || !is_same(values[kForceMost], wanted.most_n)) return "force_least, force_most";
  if (values[kLimitedBy] != wanted.limited_by) return "limited_by";
  return "";
}

}  // namespace mr_damper_controller
