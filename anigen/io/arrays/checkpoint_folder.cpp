#include "anigen/io/checkpoint_folder.h"

#include <algorithm>
#include <cctype>
#include <system_error>
#include <tuple>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/core/log.h"

namespace anigen::io {
namespace {

namespace fs = std::filesystem;

fs::path files_folder(const fs::path& folder) {
  std::error_code error;
  return fs::is_directory(folder / "ckpts", error) ? folder / "ckpts" : folder;
}

bool contains(const std::string& text, const char* part) { return text.find(part) != std::string::npos; }

std::string listed(const std::vector<std::string>& names) {
  std::string text;
  for (const std::string& name : names) text += (text.empty() ? "" : ", ") + name;
  return text.empty() ? "no checkpoint" : text;
}

/// @return the name with the highest step, the first of equals; empty when there is none
std::string newest(const std::vector<std::string>& names, bool ema) {
  std::string best;
  for (const std::string& name : names) {
    const bool state = contains(name, "misc") || name.rfind("state", 0) == 0;
    if (state || contains(name, "ema") != ema) continue;
    if (best.empty() || step_of(name) > step_of(best)) best = name;
  }
  return best;
}

}  // namespace

std::vector<std::string> checkpoint_names(const fs::path& folder) {
  std::vector<fs::path> files;
  std::error_code error;
  for (fs::directory_iterator entry(folder, error), end; !error && entry != end; entry.increment(error)) {
    const fs::path name = entry->path().filename();
    if (contains(name.string(), ".tmp-")) continue;  // what a killed writer left (core/atomic_file.h)
    if (name.extension() == ".pt" || name.extension() == ".safetensors") files.push_back(name);
  }
  if (error) throw InputError(folder.string(), "", "cannot be listed: " + error.message());
  std::sort(files.begin(), files.end(), [](const fs::path& a, const fs::path& b) {
    return std::make_tuple(a.stem().string(), a.extension().string()) <
           std::make_tuple(b.stem().string(), b.extension().string());
  });
  files.erase(std::unique(files.begin(), files.end(),
                          [](const fs::path& a, const fs::path& b) { return a.stem() == b.stem(); }),
              files.end());
  std::vector<std::string> names;
  for (const fs::path& file : files) names.push_back(file.string());
  return names;
}

std::int64_t step_of(const std::string& file_name) {
  constexpr std::string_view kMark = "step";
  constexpr std::size_t kMostDigits = 18;
  const std::size_t mark = file_name.rfind(kMark);
  if (mark == std::string::npos) return -1;
  const std::size_t first = mark + kMark.size();
  const std::string digits = file_name.substr(first, file_name.find('.', first) - first);
  const bool number = !digits.empty() && digits.size() <= kMostDigits &&
                      std::all_of(digits.begin(), digits.end(), [](unsigned char c) { return std::isdigit(c); });
  return number ? std::stoll(digits) : -1;
}

fs::path choose_flow_checkpoint(const fs::path& folder, bool prefer_ema) {
  const fs::path files = files_folder(folder);
  const std::vector<std::string> names = checkpoint_names(files);
  std::string chosen = newest(names, prefer_ema);
  if (chosen.empty()) {
    chosen = newest(names, !prefer_ema);
    if (chosen.empty()) throw InputError(files.string(), "", "holds no weights, only: " + listed(names));
    log::warn("{}: no {} weights, taking {}", files.string(), prefer_ema ? "moving-average" : "regular", chosen);
  }
  return files / chosen;
}

fs::path choose_checkpoint(const fs::path& folder, const std::string& model, const std::string& name) {
  const fs::path files = files_folder(folder);
  std::error_code error;
  std::string tried;
  for (const std::string& stem : {model + "_" + name, name}) {
    for (const char* extension : {".pt", ".safetensors"}) {
      const fs::path candidate = files / (stem + extension);
      if (fs::is_regular_file(candidate, error)) return candidate;
      tried += (tried.empty() ? "" : ", ") + candidate.filename().string();
    }
  }
  throw InputError(files.string(), "", "none of " + tried + " is there; it holds: " + listed(checkpoint_names(files)));
}

fs::path choose_decoder_checkpoint(const fs::path& folder, const std::string& name) {
  return choose_checkpoint(folder, "decoder", name);
}

std::optional<std::int64_t> latest_step(const fs::path& folder) {
  std::error_code error;
  const fs::path files = files_folder(folder);
  if (!fs::is_directory(files, error)) return std::nullopt;
  std::int64_t latest = -1;
  for (const std::string& name : checkpoint_names(files)) latest = std::max(latest, step_of(name));
  return latest < 0 ? std::nullopt : std::optional(latest);
}

}  // namespace anigen::io
