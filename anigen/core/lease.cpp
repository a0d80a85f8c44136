#include "anigen/core/lease.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>
#include <algorithm>
#include <atomic>
#include <cctype>
#include <cerrno>
#include <chrono>
#include <condition_variable>
#include <cstdio>
#include <cstring>
#include <map>
#include <mutex>
#include <set>
#include <system_error>
#include <thread>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/log.h"
#include "anigen/core/process.h"
#include "anigen/core/random.h"

namespace anigen {

namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;

constexpr const char kGivenBack[] = "given back\n";
constexpr const char kNew[] = ".new-";

[[noreturn]] void throw_errno(const fs::path& path, const std::string& action) {
  throw Error(path.string() + ": cannot " + action + ": " + std::strerror(errno));
}

double seconds_of(const struct timespec& time) {
  return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
}

/// A piece's name as part of a file's: itself where it can be, else readable and told apart by a hash. Holds no dot.
std::string file_word(const std::string& piece) {
  constexpr std::size_t kLongest = 100, kReadable = 60;
  const auto plain = [](char c) { return std::isalnum(static_cast<unsigned char>(c)) || c == '-' || c == '_'; };
  if (!piece.empty() && piece.size() <= kLongest && std::all_of(piece.begin(), piece.end(), plain)) return piece;
  std::string word = piece.substr(0, kReadable);
  std::replace_if(
      word.begin(), word.end(), [&](char c) { return !plain(c); }, '_');
  char hash[24];
  std::snprintf(hash, sizeof hash, "--%016llx", static_cast<unsigned long long>(stable_hash(piece)));
  return word + hash;
}

struct Found {
  bool given_back = false;
  std::optional<ProcessIdentity> holder;  ///< nothing: it is just being written, or damaged
  double sign_of_life = 0;                ///< by the file system's clock
};

/// @return nothing when there is no such file
std::optional<Found> read_lease(const fs::path& file) {
  // NFS asks the server what is new when a file is opened; its attributes alone may be a minute old.
  const int descriptor = ::open(file.c_str(), O_RDONLY | O_CLOEXEC);
  if (descriptor < 0) {
    if (errno == ENOENT || errno == ESTALE) return std::nullopt;
    throw_errno(file, "open");
  }
  struct stat status {};
  char text[2048];
  const bool known = ::fstat(descriptor, &status) == 0;
  const ssize_t size = ::read(descriptor, text, sizeof text);
  ::close(descriptor);
  if (!known || size < 0) return std::nullopt;
  Found found;
  found.sign_of_life = seconds_of(status.st_mtim);
  const std::string content(text, static_cast<std::size_t>(size));
  found.given_back = content == kGivenBack;
  if (found.given_back) return found;
  try {
    found.holder = process_identity_from_json(Json::parse(content));
  } catch (const Json::exception&) {
    found.holder.reset();
  }
  return found;
}

void remove_file(const fs::path& file) { ::unlink(file.c_str()); }

/// Lets a lease look as if its holder had died long ago: free at once, without any space on the disk. Its file stays,
/// because a missing number would be given to somebody else while a higher one is held.
void expire(const fs::path& lease) {
  const struct timespec long_ago[2] = {};
  ::utimensat(AT_FDCWD, lease.c_str(), long_ago, 0);
}

/// Makes a file with this content. @return false when there is one of that name
/// @param undo what becomes of a file that could not be written whole; its name must not be used again, or is ours
bool write_new(const fs::path& file, const std::string& text, void (*undo)(const fs::path&) = remove_file) {
  const int descriptor = ::open(file.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
  if (descriptor < 0 && errno == EEXIST) return false;
  if (descriptor < 0) throw_errno(file, "create");
  const bool written = ::write(descriptor, text.data(), text.size()) == static_cast<ssize_t>(text.size());
  const bool closed = ::close(descriptor) == 0;
  if (written && closed) return true;
  const int reason = errno;
  undo(file);
  errno = reason;
  throw_errno(file, "write");
}

/// Gives a file a second name, unless that is taken. An answer that got lost on the way from an NFS server looks like a
/// failure: the number of names tells.
bool link_into_place(const fs::path& file, const fs::path& name, const std::string& text) {
  if (::link(file.c_str(), name.c_str()) == 0) return true;
  const int reason = errno;
  struct stat status {};
  if (::stat(file.c_str(), &status) == 0 && status.st_nlink == 2) return true;
  if (reason == EEXIST) return false;
  // Without hard links the file is made in place: exclusive too, but for a moment without its content.
  if (reason == EPERM || reason == EOPNOTSUPP || reason == ENOSYS) return write_new(name, text, expire);
  errno = reason;
  throw_errno(name, "link");
}

using namespace std::chrono_literals;

/// Longer and longer, so that many who wait for one do not keep the file system busy.
class Patience {
 public:
  void reset() { pause_ = kShortest; }
  void wait() {
    if (pause_ == kShortest) log::info("waiting for other processes, which have what is left of the work");
    for (auto left = pause_; left > 0ms; left -= kShortest) {
      throw_if_interrupted();
      std::this_thread::sleep_for(kShortest);
    }
    pause_ = std::min(pause_ * 2, kLongest);
  }

 private:
  static constexpr std::chrono::milliseconds kShortest = 50ms, kLongest = 3200ms;
  std::chrono::milliseconds pause_ = kShortest;
};

}  // namespace

struct Lease::Held {
  std::shared_ptr<LeaseFolder::Keeper> keeper;
  fs::path file, successor;
  std::atomic<bool> lost{false};
};

/// State that the folder and its leases share: the thread that gives signs of life, and the folder's clock.
class LeaseFolder::Keeper {
 public:
  Keeper(fs::path folder, double expires) : folder(std::move(folder)), expires(expires) {}
  ~Keeper() {
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      ended_ = true;
    }
    wake_.notify_all();
    if (thread_.joinable()) thread_.join();
  }

  fs::path file(const std::string& word, std::size_t number) const {
    return folder / (word + "." + std::to_string(number));
  }

  /// A name of our own in the folder.
  fs::path unused_name() {
    static std::atomic<unsigned> counter{0};
    return folder / (kNew + process_number() + "-" + std::to_string(counter++));
  }

  bool somebody_has(const Found& lease) {
    if (lease.given_back || (lease.holder && certainly_gone(*lease.holder))) return false;
    return now() - lease.sign_of_life <= expires;
  }

  void watch(const std::shared_ptr<Lease::Held>& held) {
    const std::lock_guard<std::mutex> lock(mutex_);
    held_.insert(held.get());
    if (!thread_.joinable()) thread_ = std::thread([this] { give_signs(); });
  }

  void forget(Lease::Held* held) {
    const std::lock_guard<std::mutex> lock(mutex_);
    held_.erase(held);
  }

  const fs::path folder;
  const double expires;

 private:
  /// Time by the clock that stamps the folder's files: asked of a file now and then, counted on in between.
  double now() {
    constexpr double kTrusted = 10;  // seconds
    const std::lock_guard<std::mutex> lock(clock_mutex_);
    const Clock::time_point here = Clock::now();
    if (!asked_ || std::chrono::duration<double>(here - *asked_).count() > std::min(kTrusted, expires / 6)) {
      const fs::path probe = unused_name();
      write_new(probe, "");
      struct stat status {};
      const bool known = ::utimensat(AT_FDCWD, probe.c_str(), nullptr, 0) == 0 && ::stat(probe.c_str(), &status) == 0;
      const int reason = errno;
      ::unlink(probe.c_str());
      errno = reason;
      if (!known) throw_errno(probe, "read the time");
      asked_ = here;
      answer_ = seconds_of(status.st_mtim);
    }
    return answer_ + std::chrono::duration<double>(here - *asked_).count();
  }

  void give_signs() {
    std::unique_lock<std::mutex> lock(mutex_);
    const std::chrono::duration<double> pause(expires / 6);
    while (!wake_.wait_for(lock, pause, [this] { return ended_; })) {
      for (Lease::Held* held : held_) {
        // Without times the server's own are set, not those of this machine.
        const bool alive = ::utimensat(AT_FDCWD, held->file.c_str(), nullptr, 0) == 0;
        if ((!alive && errno == ENOENT) || ::access(held->successor.c_str(), F_OK) == 0) held->lost = true;
      }
    }
  }

  std::mutex mutex_, clock_mutex_;
  std::condition_variable wake_;
  std::set<Lease::Held*> held_;
  std::thread thread_;
  bool ended_ = false;
  std::optional<Clock::time_point> asked_;
  double answer_ = 0;
};

Lease& Lease::operator=(Lease&& other) noexcept {
  if (this != &other) {
    give_back();
    held_ = std::move(other.held_);
  }
  return *this;
}

bool Lease::held() const { return held_ && !held_->lost; }

void Lease::give_back() {
  if (!held_) return;
  held_->keeper->forget(held_.get());
  // Renamed over, not removed: the number stays taken.
  bool noted = false;
  try {
    const fs::path note = held_->keeper->unused_name();
    write_new(note, kGivenBack);
    noted = ::rename(note.c_str(), held_->file.c_str()) == 0;
    if (!noted) ::unlink(note.c_str());
  } catch (const Error&) {  // a full disk
  }
  if (!noted) expire(held_->file);
  held_.reset();
}

LeaseFolder::LeaseFolder(fs::path folder, double expires)
    : keeper_(std::make_shared<Keeper>(std::move(folder), expires)) {}

const fs::path& LeaseFolder::path() const { return keeper_->folder; }

std::optional<Lease> LeaseFolder::try_take(const std::string& piece) const {
  const std::string word = file_word(piece);
  std::size_t last = 0;
  std::optional<Found> found;
  while (std::optional<Found> next = read_lease(keeper_->file(word, last + 1))) {
    found = std::move(next);
    ++last;
  }
  make_folders(keeper_->folder);
  if (found && keeper_->somebody_has(*found)) return std::nullopt;
  const fs::path mine = keeper_->unused_name();
  const std::string text = to_json(this_process()).dump() + "\n";
  write_new(mine, text);
  auto held = std::make_shared<Lease::Held>();
  held->keeper = keeper_;
  held->file = keeper_->file(word, last + 1);
  held->successor = keeper_->file(word, last + 2);
  bool taken = false;
  try {
    taken = link_into_place(mine, held->file, text);
  } catch (const Error&) {
    ::unlink(mine.c_str());
    throw;
  }
  ::unlink(mine.c_str());
  if (!taken) return std::nullopt;
  keeper_->watch(held);
  return Lease(std::move(held));
}

void LeaseFolder::remove_left() const {
  std::map<std::string, std::size_t> last;  // number of each piece
  std::error_code error;
  for (fs::directory_iterator entry(keeper_->folder, error), end; !error && entry != end; entry.increment(error)) {
    const std::string name = entry->path().filename().string();
    const std::size_t dot = name.rfind('.');
    if (name.rfind(kNew, 0) == 0) {
      // Of a process that was killed between writing and linking.
      const std::optional<Found> left = read_lease(entry->path());
      if (left && !keeper_->somebody_has(*left)) ::unlink(entry->path().c_str());
    } else if (dot != std::string::npos) {
      std::size_t& number = last[name.substr(0, dot)];
      number = std::max(number, static_cast<std::size_t>(std::strtoull(name.c_str() + dot + 1, nullptr, 10)));
    }
  }
  for (const auto& [word, number] : last) {
    const std::optional<Found> found = read_lease(keeper_->file(word, number));
    if (found && keeper_->somebody_has(*found)) continue;
    // The highest first: who looks meanwhile finds a shorter history, never one with a hole.
    for (std::size_t n = number; n > 0; --n) ::unlink(keeper_->file(word, n).c_str());
  }
  fs::remove(keeper_->folder, error);
}

void work_together(const LeaseFolder& leases, const std::vector<std::string>& names,
                   const std::function<bool(std::size_t)>& done, const WorkPass& pass) {
  std::vector<std::size_t> left;
  for (std::size_t i = 0; i < names.size(); ++i) left.push_back(i);
  std::vector<char> ours(names.size(), 0);
  std::mutex mutex;
  Patience patience;
  for (;;) {
    throw_if_interrupted();
    left.erase(std::remove_if(left.begin(), left.end(), [&](std::size_t i) { return ours[i] != 0 || done(i); }),
               left.end());
    if (left.empty()) return;
    bool any = false;
    pass(left, [&](std::size_t piece) -> std::optional<Lease> {
      if (done(piece)) return std::nullopt;
      std::optional<Lease> lease = leases.try_take(names[piece]);
      if (!lease) return std::nullopt;
      const std::lock_guard<std::mutex> lock(mutex);
      any = true;
      if (done(piece)) return std::nullopt;  // while we were taking it
      ours[piece] = 1;
      return lease;
    });
    any ? patience.reset() : patience.wait();
  }
}

void work_in_turn(const LeaseFolder& leases, const std::vector<std::string>& names,
                  const std::function<bool(std::size_t)>& done, const std::function<void(std::size_t)>& work) {
  work_together(leases, names, done, [&](const std::vector<std::size_t>& pieces, const Claim& claim) {
    for (const std::size_t piece : pieces) {
      throw_if_interrupted();
      const std::optional<Lease> lease = claim(piece);
      if (lease) work(piece);
    }
  });
}

}  // namespace anigen
