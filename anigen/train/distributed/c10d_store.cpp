#include "anigen/train/distributed/c10d_store.h"

#if ANIGEN_HAS_C10D
#include <algorithm>
#include <utility>
#include <vector>

#include "anigen/core/error.h"

namespace anigen::train {
namespace {

class StoreKeys : public SharedKeys {
 public:
  explicit StoreKeys(StorePtr store) : store_(std::move(store)) {}

  void set(const std::string& key, const std::string& value) override {
    store_->set(key, std::vector<std::uint8_t>(value.begin(), value.end()));
  }
  std::optional<std::string> find(const std::string& key) override {
    if (!store_->check({key})) return std::nullopt;
    const std::vector<std::uint8_t> value = store_->get(key);
    return std::string(value.begin(), value.end());
  }
  std::int64_t add(const std::string& key, std::int64_t amount) override { return store_->add(key, amount); }

 private:
  StorePtr store_;
};

StorePtr plain_store(const Rendezvous& rendezvous, bool serve, std::chrono::milliseconds timeout) {
  if (!rendezvous.file.empty()) {
    constexpr int kNeverRemove = -1;  // whoever named the file removes it
    return c10::make_intrusive<c10d::FileStore>(rendezvous.file, kNeverRemove);
  }
  c10d::TCPStoreOptions options;
  options.port = static_cast<std::uint16_t>(rendezvous.port);
  options.isServer = serve && !rendezvous.served;
  options.waitWorkers = false;  // who is missing is found out later, by name
  options.timeout = timeout;
  return c10::make_intrusive<c10d::TCPStore>(rendezvous.host, options);
}

}  // namespace

StorePtr open_store(const Rendezvous& rendezvous, bool serve, std::chrono::milliseconds timeout) {
  try {
    StorePtr store = plain_store(rendezvous, serve, timeout);
    store->setTimeout(timeout);
    return c10::make_intrusive<c10d::PrefixStore>("anigen" + rendezvous.attempt, store);
  } catch (const std::exception& problem) {
    std::string line = problem.what();
    line.erase(std::min(line.find('\n'), line.size()));
    throw Error("the rendezvous " + rendezvous.text() + " cannot be " + (serve ? "opened: " : "reached: ") + line);
  }
}

std::shared_ptr<SharedKeys> keys_of(StorePtr store) { return std::make_shared<StoreKeys>(std::move(store)); }

}  // namespace anigen::train
#endif
