#include "anigen/core/sandbox.h"

#include <fcntl.h>
#include <linux/audit.h>
#include <linux/filter.h>
#include <linux/sched.h>
#include <linux/seccomp.h>
#include <sys/ioctl.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <unistd.h>
#include <algorithm>
#include <cerrno>
#include <csignal>
#include <cstddef>
#include <cstring>
#include <initializer_list>
#include <string>
#include <system_error>

#include "anigen/core/error.h"

namespace anigen {

namespace {

namespace fs = std::filesystem;

#if defined(__x86_64__)
constexpr std::uint32_t kMachine = AUDIT_ARCH_X86_64;
#elif defined(__aarch64__)
constexpr std::uint32_t kMachine = AUDIT_ARCH_AARCH64;
#else
constexpr std::uint32_t kMachine = 0;  // no filter: the numbers below are not checked there
#endif

/// Calls that are newer than the headers of some systems, by the numbers that all machines share.
enum NewCall : int {
  kPidfdSendSignal = 424,
  kIoUringSetup = 425,
  kIoUringEnter = 426,
  kIoUringRegister = 427,
  kOpenTree = 428,
  kMoveMount = 429,
  kFsopen = 430,
  kFsconfig = 431,
  kFsmount = 432,
  kFspick = 433,
  kPidfdOpen = 434,
  kClone3 = 435,
  kOpenat2 = 437,
  kPidfdGetfd = 438,
  kProcessMadvise = 440,
  kMountSetattr = 442,
  kLandlockCreate = 444,
  kLandlockAddRule = 445,
  kLandlockRestrict = 446,
  kFchmodat2 = 452,
  kSetxattrat = 463,
  kRemovexattrat = 466,
};

constexpr int kAlwaysRefused[] = {
    // programs
    SYS_execve,
    SYS_execveat,
    // the network, services of this machine; io_uring opens sockets and files by calls of its own
    SYS_socket,
    SYS_connect,
    SYS_bind,
    SYS_listen,
    SYS_accept,
    SYS_accept4,
    kIoUringSetup,
    kIoUringEnter,
    kIoUringRegister,
    // other processes
    SYS_ptrace,
    SYS_process_vm_readv,
    SYS_process_vm_writev,
    SYS_kcmp,
    SYS_rt_sigqueueinfo,
    SYS_rt_tgsigqueueinfo,
    kPidfdSendSignal,
    kPidfdOpen,
    kPidfdGetfd,
    kProcessMadvise,
    // mounts and namespaces
    SYS_mount,
    SYS_umount2,
    SYS_pivot_root,
    SYS_chroot,
    SYS_unshare,
    SYS_setns,
    kOpenTree,
    kMoveMount,
    kFsopen,
    kFsconfig,
    kFsmount,
    kFspick,
    kMountSetattr,
    // the kernel and the machine
    SYS_bpf,
    SYS_perf_event_open,
    SYS_userfaultfd,
    SYS_add_key,
    SYS_keyctl,
    SYS_request_key,
    SYS_init_module,
    SYS_finit_module,
    SYS_delete_module,
    SYS_kexec_load,
    SYS_reboot,
    SYS_swapon,
    SYS_swapoff,
    SYS_sethostname,
    SYS_setdomainname,
    SYS_settimeofday,
    SYS_clock_settime,
    SYS_adjtimex,
    SYS_clock_adjtime,
    SYS_acct,
    SYS_quotactl,
    SYS_syslog,
    SYS_open_by_handle_at,
    // owners, modes and attributes of files, which Landlock does not hold
    SYS_fchownat,
    SYS_fchown,
    SYS_fchmodat,
    kFchmodat2,
    SYS_setxattr,
    SYS_lsetxattr,
    SYS_fsetxattr,
    SYS_removexattr,
    SYS_lremovexattr,
    SYS_fremovexattr,
    kSetxattrat,
    kRemovexattrat,
    SYS_mknodat,
#ifdef __x86_64__
    SYS_chown,
    SYS_lchown,
    SYS_chmod,
    SYS_mknod,
    SYS_iopl,
    SYS_ioperm,
    SYS_kexec_file_load,
#endif
};

/// Refused where no folder is writable, beside opening for writing.
constexpr int kChangesOfFiles[] = {
    SYS_truncate, SYS_ftruncate, SYS_fallocate, SYS_unlinkat,  SYS_renameat2,
    SYS_linkat,   SYS_symlinkat, SYS_mkdirat,   SYS_utimensat, SYS_fchmod,
#ifdef SYS_renameat
    SYS_renameat,
#endif
#ifdef __x86_64__
    SYS_creat,    SYS_unlink,    SYS_rename,    SYS_link,      SYS_symlink,
    SYS_mkdir,    SYS_rmdir,     SYS_utime,     SYS_utimes,    SYS_futimesat,
#endif
};

constexpr std::uint32_t kNamespaces =
    CLONE_NEWNS | CLONE_NEWCGROUP | CLONE_NEWUTS | CLONE_NEWIPC | CLONE_NEWUSER | CLONE_NEWPID | CLONE_NEWNET;

/// A filter of system calls in the kernel's language (BPF): the number of the call is compared with one after the
/// other.
class CallFilter {
 public:
  CallFilter() {
    load(offsetof(seccomp_data, arch));
    add(BPF_JMP | BPF_JEQ | BPF_K, kMachine, 1, 0);
    refuse(EPERM);  // calls of another machine's language have other numbers
    load_number();
#ifdef __x86_64__
    constexpr std::uint32_t kX32 = 0x40000000;
    add(BPF_JMP | BPF_JSET | BPF_K, kX32, 0, 1);
    refuse(ENOSYS);
#endif
  }

  void refuse_call(int call, int error = EPERM) {
    add(BPF_JMP | BPF_JEQ | BPF_K, static_cast<std::uint32_t>(call), 0, 1);
    refuse(error);
  }
  /// When one of the bits of an argument is set.
  void refuse_bits(int call, int argument, std::uint32_t bits, int error = EPERM) {
    look_at(call, argument);
    add(BPF_JMP | BPF_JSET | BPF_K, bits, 0, 1);
    refuse(error);
    load_number();
  }
  /// When none of the bits is set.
  void refuse_without(int call, int argument, std::uint32_t bits) {
    look_at(call, argument);
    add(BPF_JMP | BPF_JSET | BPF_K, bits, 1, 0);
    refuse(EPERM);
    load_number();
  }
  void refuse_value(int call, int argument, std::uint32_t value) {
    look_at(call, argument);
    add(BPF_JMP | BPF_JEQ | BPF_K, value, 0, 1);
    refuse(EPERM);
    load_number();
  }
  void refuse_others(int call, int argument, std::uint32_t value) {
    look_at(call, argument);
    add(BPF_JMP | BPF_JEQ | BPF_K, value, 1, 0);
    refuse(EPERM);
    load_number();
  }

  /// For this process from now on. @return false when the kernel refuses
  bool install() {
    add(BPF_RET | BPF_K, SECCOMP_RET_ALLOW, 0, 0);
    sock_fprog program{static_cast<unsigned short>(code_.size()), code_.data()};
    return ::syscall(SYS_seccomp, SECCOMP_SET_MODE_FILTER, SECCOMP_FILTER_FLAG_TSYNC, &program) == 0;
  }

 private:
  void add(int code, std::uint32_t value, int if_so, int if_not) {
    code_.push_back(
        {static_cast<std::uint16_t>(code), static_cast<std::uint8_t>(if_so), static_cast<std::uint8_t>(if_not), value});
  }
  void load(std::size_t offset) { add(BPF_LD | BPF_W | BPF_ABS, static_cast<std::uint32_t>(offset), 0, 0); }
  void load_number() { load(offsetof(seccomp_data, nr)); }
  void refuse(int error) { add(BPF_RET | BPF_K, SECCOMP_RET_ERRNO | static_cast<std::uint32_t>(error), 0, 0); }
  /// The lower half of an argument, in the four instructions that follow when the call is this one.
  void look_at(int call, int argument) {
    constexpr int kRest = 4;
    add(BPF_JMP | BPF_JEQ | BPF_K, static_cast<std::uint32_t>(call), 0, kRest);
    load(offsetof(seccomp_data, args) + sizeof(std::uint64_t) * static_cast<std::size_t>(argument));
  }

  std::vector<sock_filter> code_;
};

bool refuse_calls(const SandboxRights& rights) {
  if (kMachine == 0) return false;
  CallFilter filter;
  for (const int call : kAlwaysRefused) filter.refuse_call(call);
  // Its flags are in memory, where a filter cannot look; without it the C library falls back to clone.
  filter.refuse_call(kClone3, ENOSYS);
  filter.refuse_bits(SYS_clone, 0, kNamespaces);
  for (const unsigned long keys : {TIOCSTI, TIOCLINUX})  // input of a terminal as if it were typed
    filter.refuse_value(SYS_ioctl, 1, static_cast<std::uint32_t>(keys));
  if (!rights.processes) {
    const auto self = static_cast<std::uint32_t>(::getpid());
    filter.refuse_without(SYS_clone, 0, CLONE_THREAD);
    filter.refuse_others(SYS_kill, 0, self);
    filter.refuse_others(SYS_tgkill, 0, self);
    filter.refuse_call(SYS_tkill);
#ifdef __x86_64__
    filter.refuse_call(SYS_fork);
    filter.refuse_call(SYS_vfork);
#endif
  }
  if (rights.writable.empty()) {
    constexpr std::uint32_t kWriting = O_WRONLY | O_RDWR | O_CREAT | O_TRUNC;
    for (const int call : kChangesOfFiles) filter.refuse_call(call, EACCES);
    filter.refuse_call(kOpenat2, ENOSYS);  // as clone3
    filter.refuse_bits(SYS_openat, 2, kWriting, EACCES);
#ifdef __x86_64__
    filter.refuse_bits(SYS_open, 1, kWriting, EACCES);
#endif
  }
  return filter.install();
}

/// The kernel's structures of Landlock, which headers of older systems have in part.
struct LandlockRules {
  std::uint64_t files, network, scope;
};
struct __attribute__((packed)) LandlockPlace {
  std::uint64_t rights;
  std::int32_t descriptor;
};

enum LandlockRight : std::uint64_t {
  kExecute = 1U << 0,
  kWrite = 1U << 1,
  kRemoveFolder = 1U << 4,
  kRemoveFile = 1U << 5,
  kMakeDevice = 1U << 6 | 1U << 11,
  kMakeFolder = 1U << 7,
  kMakeFile = 1U << 8,
  kMakeSocket = 1U << 9,
  kMakePipe = 1U << 10,
  kMakeLink = 1U << 12,
  kMoveBetweenFolders = 1U << 13,  // version 2
  kTruncate = 1U << 14,            // version 3
};

/// @return version of the kernel's Landlock; 0: it has none
long landlock_version() {
  constexpr unsigned kVersion = 1;
  return std::max(0L, ::syscall(kLandlockCreate, nullptr, 0, kVersion));
}

/// Allows rights in a folder, or on a file. @return false when it cannot be opened
bool allow_place(int rules, const fs::path& place, std::uint64_t rights) {
  constexpr int kBeneath = 1;
  const int descriptor = ::open(place.c_str(), O_PATH | O_CLOEXEC);
  if (descriptor < 0) return false;
  const LandlockPlace allowed{rights, descriptor};
  const bool done = ::syscall(kLandlockAddRule, rules, kBeneath, &allowed, 0) == 0;
  ::close(descriptor);
  return done;
}

bool hold_folders(const SandboxRights& rights) {
  const long version = landlock_version();
  if (version == 0) return false;
  std::uint64_t changes = kWrite | kRemoveFolder | kRemoveFile | kMakeFolder | kMakeFile;
  if (version >= 2) changes |= kMoveBetweenFolders;
  if (version >= 3) changes |= kTruncate;
  constexpr std::uint64_t kNever = kExecute | kMakeDevice | kMakeSocket | kMakePipe | kMakeLink;
  constexpr std::uint64_t kBindAndConnect = 3, kForeignSocketsAndSignals = 3;
  const LandlockRules held{changes | kNever, version >= 4 ? kBindAndConnect : 0,
                           version >= 6 ? kForeignSocketsAndSignals : 0};
  const std::size_t size = version >= 6 ? sizeof held : version >= 4 ? 2 * sizeof held.files : sizeof held.files;
  const int rules = static_cast<int>(::syscall(kLandlockCreate, &held, size, 0));
  if (rules < 0) return false;
  bool done = allow_place(rules, "/dev/null", kWrite | (changes & kTruncate));
  for (const fs::path& folder : rights.writable) done = allow_place(rules, folder, changes) && done;
  done = done && ::syscall(kLandlockRestrict, rules, 0) == 0;
  ::close(rules);
  return done;
}

void lower(__rlimit_resource_t resource, std::uint64_t value) {
  rlimit limit{};
  if (::getrlimit(resource, &limit) != 0) return;
  limit.rlim_cur = limit.rlim_max = std::min<rlim_t>(value, limit.rlim_max);
  ::setrlimit(resource, &limit);
}

/// Number of the last descriptor that is open; −1 when the system does not say.
int last_descriptor() {
  std::error_code error;
  int last = -1;
  for (fs::directory_iterator entry("/proc/self/fd", error), end; !error && entry != end; entry.increment(error)) {
    const std::string name = entry->path().filename().string();
    last = std::max(last, std::atoi(name.c_str()));
  }
  return last;
}

bool filters_work() {
  const std::uint32_t errors = SECCOMP_RET_ERRNO;
  return kMachine != 0 && ::syscall(SYS_seccomp, SECCOMP_GET_ACTION_AVAIL, 0, &errors) == 0;
}

}  // namespace

SandboxMeans sandbox_means() { return {filters_work(), landlock_version() > 0}; }

SandboxMeans enter_sandbox(const SandboxRights& rights) {
  for (const fs::path& folder : rights.writable) {
    std::error_code error;
    if (!fs::is_directory(folder, error))
      throw Error(folder.string() + ": " + (error ? error.message() : "is no folder"));
  }
  std::signal(SIGXFSZ, SIG_IGN);  // writing too much is then an error code, not our end
  lower(RLIMIT_CORE, 0);
  lower(RLIMIT_FSIZE, rights.file_bytes);
  if (const int last = last_descriptor(); last >= 0)
    lower(RLIMIT_NOFILE, static_cast<std::uint64_t>(last) + 1 + static_cast<std::uint64_t>(rights.more_files));
  if (::prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) != 0) return {};
  SandboxMeans means;
  means.folders = hold_folders(rights);
  means.calls = refuse_calls(rights);
  return means;
}

}  // namespace anigen
