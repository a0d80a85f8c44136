#include "anigen/core/log.h"

#include <spdlog/sinks/basic_file_sink.h>
#include <spdlog/sinks/stdout_color_sinks.h>

#include <memory>
#include <mutex>
#include <set>

#include "anigen/core/error.h"

namespace anigen::log {

void setup(const std::string& level) {
  static const char* const levels[] = {"debug", "info", "warn", "error", "off"};
  bool known = false;
  for (const char* name : levels) known = known || level == name;
  if (!known) throw InputError("", "--log-level", "unknown level '" + level + "'; use debug, info, warn, error or off");
  auto sink = std::make_shared<spdlog::sinks::stderr_color_sink_mt>();
  sink->set_pattern("%^[%l]%$ %v");
  auto logger = std::make_shared<spdlog::logger>("anigen", sink);
  logger->set_level(spdlog::level::from_str(level));
  spdlog::set_default_logger(logger);
}

void also_to_file(const std::filesystem::path& file) {
  auto sink = std::make_shared<spdlog::sinks::basic_file_sink_mt>(file.string());
  sink->set_pattern("%Y-%m-%d %H:%M:%S [%l] %v");
  spdlog::default_logger()->sinks().push_back(sink);
  spdlog::default_logger()->flush_on(spdlog::level::info);
}

void warn_once(const std::string& message) {
  static std::mutex mutex;
  static std::set<std::string> said;
  const std::lock_guard<std::mutex> lock(mutex);
  if (said.insert(message).second) spdlog::warn("{}", message);
}

}  // namespace anigen::log
