#pragma once
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <functional>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "anigen/apps/common/options.h"
#include "anigen/apps/common/torch_half.h"
#include "anigen/core/text.h"

namespace anigen {

/// Checks of numbers while the command line is parsed, so that a value out of range ends a program at once, with the
/// option and the range. CLI11 alone reads "-5" as a huge unsigned number, and its own range takes "nan".

inline constexpr std::uint64_t kAnyNumber = std::numeric_limits<std::uint64_t>::max();  ///< no upper end

namespace detail {

inline std::string range_text(std::int64_t least, std::uint64_t most) {
  const std::string from = std::to_string(least);
  return most == kAnyNumber ? "of at least " + from : "from " + from + " to " + std::to_string(most);
}

/// Decimal digits, perhaps behind a minus; no leading zeros, which CLI11 would read as octal.
inline bool in_whole_range(const std::string& text, std::int64_t least, std::uint64_t most) {
  const bool negative = !text.empty() && text[0] == '-';
  const std::string digits = text.substr(negative ? 1 : 0);
  if (digits.empty() || digits.find_first_not_of("0123456789") != std::string::npos) return false;
  if (digits.size() > 1 && digits[0] == '0') return false;
  errno = 0;
  if (negative) {
    const long long value = std::strtoll(text.c_str(), nullptr, 10);
    return errno == 0 && value >= least;
  }
  const unsigned long long value = std::strtoull(digits.c_str(), nullptr, 10);
  return errno == 0 && value <= most && (least <= 0 || value >= static_cast<std::uint64_t>(least));
}

inline std::string number_text(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%g", value);
  return text;
}

}  // namespace detail

/// A whole number from `least` to `most`.
inline CLI::Validator whole_number(std::int64_t least, std::uint64_t most = kAnyNumber) {
  const std::string range = detail::range_text(least, most);
  return CLI::Validator(
      [=](std::string& text) {
        if (detail::in_whole_range(text, least, most)) return std::string();
        return "'" + text + "' is not a whole number " + range;
      },
      most == kAnyNumber ? ">=" + std::to_string(least) : std::to_string(least) + ".." + std::to_string(most));
}

enum class RangeEnds { kClosed, kOpenBelow, kOpenAbove };

/// A finite number from `least` to `most`, one of which may be left out.
inline CLI::Validator number(double least, double most = std::numeric_limits<double>::infinity(),
                             RangeEnds ends = RangeEnds::kClosed) {
  const std::string from = detail::number_text(least), to = detail::number_text(most);
  std::string range, brief;
  if (std::isinf(most)) {
    range = (ends == RangeEnds::kOpenBelow ? "above " : "of at least ") + from;
    brief = (ends == RangeEnds::kOpenBelow ? ">" : ">=") + from;
  } else {
    range = ends == RangeEnds::kOpenBelow
                ? "above " + from + " and at most " + to
                : "from " + from + (ends == RangeEnds::kOpenAbove ? " to below " : " to ") + to;
    brief = from + ".." + to;
  }
  return CLI::Validator(
      [=](std::string& text) {
        char* end = nullptr;
        const double value = std::strtod(text.c_str(), &end);
        const bool above = ends == RangeEnds::kOpenBelow ? value > least : value >= least;
        const bool below = ends == RangeEnds::kOpenAbove ? value < most : value <= most;
        if (!text.empty() && end == text.c_str() + text.size() && std::isfinite(value) && above && below)
          return std::string();
        return "'" + text + "' is not a finite number " + range;
      },
      brief);
}

/// One of a few words.
inline CLI::Validator one_of(const std::vector<std::string>& words) {
  return CLI::Validator(
      [words](std::string& text) {
        const bool known = std::find(words.begin(), words.end(), text) != words.end();
        return known ? std::string() : "'" + text + "' is none of " + joined(words);
      },
      std::string());
}

/// cpu, cuda or cuda:N.
inline CLI::Validator device_name() {
  return CLI::Validator(
      [](std::string& text) {
        const bool numbered = text.rfind("cuda:", 0) == 0 && detail::in_whole_range(text.substr(5), 0, 1023);
        if (text == "cpu" || text == "cuda" || numbered) return std::string();
        return "'" + text + "' is none of cpu, cuda and cuda:N";
      },
      std::string());
}

/// Values of the options that programs share.
struct CommonOptions {
  std::optional<std::uint64_t> seed;  ///< unset: 0, or a config's own
  int threads = 0;                    ///< 0: all cores
  std::string device = "cpu";         ///< cpu, cuda, cuda:N
  std::string log_level = "info";
  bool quiet = false, verbose = false;
  bool json = false;  ///< print machine-readable JSON on standard output
  bool keep_going = false;
};

/// A program: its command line, made of rows of options.h, and the way it ends.
struct Program {
  /// @param name "anigen-eval" @param examples lines for the end of --help
  Program(const std::string& name, const std::string& purpose, const std::string& examples);

  /// A subcommand; options of the program may stand after its word.
  CLI::App& command(const std::string& name, const std::string& purpose);
  /// Adds some of --seed --threads --device --json --keep-going, and what every program has: --quiet --verbose
  /// --log-level --check-options --completion --man --version. @param names with a note behind, such as "--seed [0]"
  /// @param version_details extra lines of --version; may be empty
  void add_common(const std::vector<std::string>& names, std::function<std::string()> version_details = {});
  /// Parses, sets up logging, threads and the interrupt handler, runs `check` and then body, and turns exceptions into
  /// one clear line and an exit status: 0, 2 for bad input, 1 for a failed run, 130 after Ctrl-C. With --check-options
  /// it leaves the body out.
  int run(int argc, char** argv, const std::function<void()>& body);
  bool only_checks() const { return check_options_; }  ///< --check-options was given

  CLI::App app;
  CommonOptions common;
  std::string first;  ///< option whose value may stand without its name (with_named_word()), such as "--image"
  /// Refuses options that contradict each other. It reads no file that an earlier program would make; may be empty.
  std::function<void()> check;
  std::vector<std::string> words;  ///< of run(): argv with names of today

 private:
  std::string completion_;
  bool man_ = false, check_options_ = false;
};

/// Words of a command line with `name` before the first that is neither an option nor an option's value, so that
/// `anigen-rig --method curve a.glb` means `anigen-rig --method curve --mesh a.glb`.
std::vector<std::string> with_named_word(const CLI::App& app, std::vector<std::string> words, const std::string& name);

/// Refuses options that the rest of a command line leaves without effect.
/// @param reason why, and what to do @throws InputError naming the first of them that was given
void refuse_given(const CLI::App& app, const std::vector<std::string>& names, const std::string& reason);

/// Ends a program of which some inputs failed, after the others are done: when none is left, and unless --keep-going
/// allows it. @param what "images gave no asset" @throws Error counting them
void require_inputs(std::size_t failed, std::size_t all, const std::string& what, const CommonOptions& common);
/// Ends it likewise where each input has a report with a `failure`.
template <typename Reports>
void require_inputs(const Reports& reports, const std::string& what, const CommonOptions& common) {
  const auto failed = [](const auto& report) { return !report.failure.empty(); };
  const auto count = std::count_if(reports.begin(), reports.end(), failed);
  require_inputs(static_cast<std::size_t>(count), reports.size(), what, common);
}

/// The options of every program that clusters votes for joints; what is not given is 0, that of the run.
/// @param clustering skeleton_field::MeanShiftOptions
template <class MeanShiftOptions>
void add_clustering_options(CLI::App& app, MeanShiftOptions& clustering) {
  clustering.bandwidth = 0;
  clustering.min_cluster_size = 0;
  add_option(app, "--cluster-bandwidth", clustering.bandwidth)
      ->check(number(0, 1, RangeEnds::kOpenBelow))
      ->default_str("");
  add_option(app, "--cluster-min-votes", clustering.min_cluster_size)
      ->check(whole_number(1, 1'000'000))
      ->default_str("");
  using Form = decltype(clustering.form);
  const auto word = std::make_shared<std::string>();
  add_option(app, "--cluster-algorithm", *word)->each([word, &clustering](const std::string& chosen) {
    clustering.form = chosen == "paper" ? Form::kPaper : Form::kPublished;
  });
}

/// Prints a program's result on standard output: with --json as JSON, else as text.
void print_result(const Json& json, const std::string& text, const CommonOptions& common);

/// Lines that --version adds: libraries of the half that needs LibTorch, which is loaded for them.
inline std::function<std::string()> library_versions() {
#ifdef ANIGEN_WITH_TORCH
  return [] { return torch_half("--version").version_details(); };
#else
  return {};
#endif
}

}  // namespace anigen
