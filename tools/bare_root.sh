# shellcheck shell=bash
# Fresh, minimal roots of a distribution, for tools/check_setup and tools/check_packages; sourced. Needs root. It sets
# `root`, the folder, and removes it when the script ends, unless `keep` is set.

# The mirror in use on this machine that carries the suite, or what PALPATE_MIRROR names.
mirror_for() {
  local name=$1 address
  while read -r address; do
    if [ "${address##*/}" = "$name" ]; then
      echo "$address"
      return
    fi
  done < <({
    cat /etc/apt/sources.list /etc/apt/sources.list.d/*.list 2>/dev/null |
      sed -nE 's/^deb( \[[^]]*\])? +([^ ]+).*/\2/p'
    sed -nE 's/^URIs: *//p' /etc/apt/sources.list.d/*.sources 2>/dev/null | tr ' ' '\n'
  } | sed 's,/*$,,')
  [ -n "${PALPATE_MIRROR:-}" ] || die "no APT mirror of $name is in use here: give its address in PALPATE_MIRROR"
  echo "$PALPATE_MIRROR"
}

# make_root SUITE: bookworm, jammy or noble
make_root() {
  local suite=$1 mirror components script options=()
  case $suite in
    bookworm) mirror=$(mirror_for debian) components=main ;;
    jammy | noble) mirror=$(mirror_for ubuntu) components=main,universe ;;
    *) die "unknown suite '$suite'" ;;
  esac
  if ! command -v debootstrap >/dev/null; then
    apt-get update -q && apt-get install -q -y --no-install-recommends debootstrap
  fi
  root=$(mktemp -d "${TMPDIR:-/tmp}/palpate-root-$suite.XXXXXX")
  trap finish_root EXIT
  script=/usr/share/debootstrap/scripts/$suite
  [ -e "$script" ] || script=/usr/share/debootstrap/scripts/gutsy # what every Ubuntu name points to
  # A Debian machine does not have Ubuntu's keys; apt inside the root has them and does verify.
  [ "$suite" = bookworm ] || [ -e /usr/share/keyrings/ubuntu-archive-keyring.gpg ] || options+=(--no-check-gpg)
  case $mirror in https:*) options+=(--include=ca-certificates) ;; esac
  debootstrap --variant=minbase --components="$components" "${options[@]}" "$suite" "$root" "$mirror" "$script"
  # dpkg need not wait for the disk after each file of a root that is thrown away
  echo force-unsafe-io >"$root/etc/dpkg/dpkg.cfg.d/bare-root"
  carry_network_settings
}

finish_root() {
  if [ "${keep:-}" ]; then echo "root kept in $root"; else rm -rf --one-file-system "$root"; fi
}

carry_network_settings() {
  cp -L /etc/resolv.conf "$root/etc/resolv.conf"
  apt-config dump | { grep -iE '^Acquire::(http|https)::Proxy|^Acquire::Check-' || true; } \
    >"$root/etc/apt/apt.conf.d/90bare-root"
  if ls /usr/local/share/ca-certificates/*.crt >/dev/null 2>&1; then
    mkdir -p "$root/usr/local/share/ca-certificates"
    cp /usr/local/share/ca-certificates/*.crt "$root/usr/local/share/ca-certificates/"
    if [ -x "$root/usr/sbin/update-ca-certificates" ]; then chroot "$root" update-ca-certificates; fi
    echo "cafile=/etc/ssl/certs/ca-certificates.crt" >>"$root/root/.npmrc"
  fi
  cat /etc/npmrc "$HOME/.npmrc" 2>/dev/null | grep '^registry' >>"$root/root/.npmrc" || true
}

# copy_tracked FOLDER [GIT LS-FILES OPTION...]: the repository's files into a folder of the root
copy_tracked() {
  local folder=$1
  shift
  mkdir -p "$root/$folder"
  git ls-files -z --cached "$@" | while IFS= read -r -d '' file; do
    [ ! -e "$file" ] || printf '%s\0' "$file"
  done | tar --null --files-from=- --create --file=- | tar -C "$root/$folder" --extract --file=-
}

# in_root COMMAND...: with the environment of `carried` (NAME=value) and the proxies. The mounts live in a namespace of
# their own and vanish with the last process in it.
carried=()
in_root() {
  local name proxies=()
  for name in http_proxy https_proxy no_proxy; do
    [ -z "${!name:-}" ] || proxies+=("$name=${!name}")
  done
  # shellcheck disable=SC2016
  unshare --mount --pid --fork sh -c '
    mount -t proc proc "$0/proc" && mount --rbind /dev "$0/dev" || echo "bare root: goes on without /proc and /dev" >&2
    root=$0
    exec chroot "$root" "$@"' "$root" \
    env -i PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin HOME=/root LANG=C.UTF-8 \
    "${proxies[@]}" "${carried[@]}" "$@"
}
