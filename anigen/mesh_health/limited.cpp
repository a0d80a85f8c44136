#include "anigen/mesh_health/limited.h"

#include <sys/mman.h>

#include <algorithm>
#include <atomic>
#include <cstring>
#include <memory>
#include <new>
#include <optional>
#include <string_view>
#include <type_traits>

#include "anigen/core/error.h"
#include "anigen/core/log.h"
#include "anigen/core/process.h"

namespace anigen::mesh_health {

namespace {

constexpr double kWeek = 7 * 24 * 3600.0;
constexpr char kDone = 'd', kInputError = 'i', kError = 'e', kNoMemory = 'm';

/// Steps that the copy counts and this process reads.
struct SharedSteps {
  std::atomic<std::uint64_t> done{0}, total{0};
};

struct Unmap {
  void operator()(SharedSteps* steps) const { ::munmap(steps, sizeof(SharedSteps)); }
};

std::unique_ptr<SharedSteps, Unmap> shared_steps() {
  void* const memory = ::mmap(nullptr, sizeof(SharedSteps), PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
  if (memory == MAP_FAILED) throw Error("the system gives no memory to share");
  return std::unique_ptr<SharedSteps, Unmap>(new (memory) SharedSteps);
}

template <typename T>
void append(const std::vector<T>& items, std::string& bytes) {
  static_assert(std::is_trivially_copyable_v<T> || std::is_same_v<T, Eigen::Vector3f>);
  const std::uint64_t count = items.size();
  bytes.append(reinterpret_cast<const char*>(&count), sizeof count);
  bytes.append(reinterpret_cast<const char*>(items.data()), count * sizeof(T));
}

template <typename T>
std::vector<T> take(std::string_view& bytes) {
  std::uint64_t count = 0;
  if (bytes.size() < sizeof count) throw Error("the result of the work is cut short");
  std::memcpy(&count, bytes.data(), sizeof count);
  bytes.remove_prefix(sizeof count);
  if (count > bytes.size() / sizeof(T)) throw Error("the result of the work is cut short");
  std::vector<T> items(static_cast<std::size_t>(count));
  if (count > 0) std::memcpy(static_cast<void*>(items.data()), bytes.data(), items.size() * sizeof(T));
  bytes.remove_prefix(items.size() * sizeof(T));
  return items;
}

std::string packed(const MeshResult& result) {
  std::string bytes(1, kDone);
  append(result.mesh.vertices, bytes);
  append(result.mesh.faces, bytes);
  append(result.place, bytes);
  return bytes + result.figures.dump();
}

MeshResult unpacked(std::string_view bytes) {
  MeshResult result;
  result.mesh.vertices = take<Eigen::Vector3f>(bytes);
  result.mesh.faces = take<Triangle>(bytes);
  result.place = take<std::int32_t>(bytes);
  result.figures = Json::parse(bytes);
  return result;
}

/// Parts of an InputError, which may hold anything but this character.
constexpr char kSeparator = '\0';

std::string outcome(const std::function<MeshResult(const StepReport&)>& work, const StepReport& report) {
  try {
    return packed(work(report));
  } catch (const InputError& error) {
    return kInputError + error.file() + kSeparator + error.place() + kSeparator + error.problem();
  } catch (const std::bad_alloc&) {
    return std::string(1, kNoMemory);
  } catch (const std::exception& error) {
    return kError + std::string(error.what());
  }
}

[[noreturn]] void throw_input_error(const std::string& text) {
  const std::size_t first = text.find(kSeparator), second = text.find(kSeparator, first + 1);
  throw InputError(text.substr(0, first), text.substr(first + 1, second - first - 1), text.substr(second + 1));
}

}  // namespace

MeshResult run_limited(const std::string& label, const std::function<MeshResult(const StepReport&)>& work,
                       const WorkLimits& limits) {
  const auto steps = shared_steps();
  SharedSteps* const shared = steps.get();
  const StepReport report = [shared](std::size_t done, std::size_t total) {
    shared->done.store(done);
    shared->total.store(total);
  };
  std::optional<Progress> progress;
  std::size_t shown = 0, expected = 0;
  ProcessLimits process;
  process.cpu_seconds = limits.seconds > 0 ? limits.seconds : kWeek;
  process.more_memory = limits.memory;
  process.while_waiting = [&] {
    throw_if_interrupted();
    const std::size_t total = shared->total.load(), done = std::min<std::size_t>(shared->done.load(), total);
    if (total == 0) return;
    if (!progress || total != expected) {
      progress.emplace(label, total, "steps");
      expected = total;
      shown = 0;
    }
    if (done > shown) progress->advance(done - shown);
    shown = std::max(shown, done);
  };
  const GuardedWork done = run_guarded([&] { return outcome(work, report); }, process);
  progress.reset();
  if (!done.finished) throw Error(label + " " + done.failure);
  const std::string rest = done.result.empty() ? "" : done.result.substr(1);
  switch (done.result.empty() ? kError : done.result.front()) {
    case kDone:
      return unpacked(rest);
    case kInputError:
      throw_input_error(rest);
    case kNoMemory:
      throw Error(label + " needs more memory than it may have");
    default:
      throw Error(rest);
  }
}

}  // namespace anigen::mesh_health
