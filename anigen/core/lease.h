#pragma once
#include <cstddef>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace anigen {

/// A piece of work that this process has to itself until it is destroyed. A thread keeps it fresh.
class Lease {
 public:
  struct Held;
  explicit Lease(std::shared_ptr<Held> held) : held_(std::move(held)) {}
  Lease(Lease&&) noexcept = default;
  Lease& operator=(Lease&& other) noexcept;
  ~Lease() { give_back(); }

  /// Nobody has taken it over, as far as the last sign of life could see. False says that this process stood still for
  /// so long that another one counts it as dead: what it goes on to write must be what the other one writes, too.
  bool held() const;

 private:
  void give_back();
  std::shared_ptr<Held> held_;
};

/// Leases on named pieces of work, as files of a folder that any number of processes on any number of machines share.
///
/// The n-th lease on a piece is the file `<piece>.<n>`, which is made under another name and linked into place: of all
/// who try, the file system lets exactly one succeed, on NFS (version 2 and later) too. It says who holds it; its time
/// of change is the sign of life. Who finds the last lease of a piece given back, or its holder dead, takes the next
/// number. Numbers are not used twice, so that two who find the same lease abandoned cannot both follow it.
/// Dead is a holder on this machine whose process ended, and one elsewhere that has given no sign of life for
/// `expires` seconds, by the clock of the folder's own file system: clocks of machines need not agree.
///
/// A process that stands still for longer than that and then goes on works beside its successor. So work under a lease
/// must end the same way when it is done twice: files that are renamed into place, equal bytes.
class LeaseFolder {
 public:
  static constexpr double kExpires = 120;

  /// Touches nothing yet. @param expires seconds without a sign of life, of which there are six in that time
  explicit LeaseFolder(std::filesystem::path folder, double expires = kExpires);

  /// Does not wait; for several threads. @param piece any text @return nothing when somebody has it @throws Error when
  /// the folder cannot be written
  std::optional<Lease> try_take(const std::string& piece) const;

  /// Removes what leases left that nobody holds any more, and the folder when nothing else is in it. For who knows that
  /// the work is done.
  void remove_left() const;

  const std::filesystem::path& path() const;

 private:
  class Keeper;
  friend struct Lease::Held;
  std::shared_ptr<Keeper> keeper_;
};

/// Asks for one piece of the work. @return its lease; nothing when somebody else has it or has done it. For several
/// threads if `done` of work_together() is
using Claim = std::function<std::optional<Lease>(std::size_t piece)>;

/// Takes some pieces to work on: claims each once, in any order and from any thread, and does what it gets.
using WorkPass = std::function<void(const std::vector<std::size_t>& pieces, const Claim& claim)>;

/// Work that any number of processes share by leases: each takes what nobody else has, until every piece is done, here
/// or elsewhere. Pieces of a process that died are taken over; who finds nothing to take waits for those who work, so
/// that the end is the end of all the work, whoever is left to see it.
/// @param names of the pieces; the same for everybody
/// @param done whether a piece is done, by whomever; asked before a lease is taken and again under it. A piece that was
/// claimed here counts as done here afterwards, whatever this says: a failure is not tried twice
/// @throws Interrupted after Ctrl-C; what `pass` throws
void work_together(const LeaseFolder& leases, const std::vector<std::string>& names,
                   const std::function<bool(std::size_t)>& done, const WorkPass& pass);

/// Works through the pieces one after the other. @param work is called under the lease
void work_in_turn(const LeaseFolder& leases, const std::vector<std::string>& names,
                  const std::function<bool(std::size_t)>& done, const std::function<void(std::size_t)>& work);

}  // namespace anigen
