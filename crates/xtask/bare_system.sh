#!/bin/sh
# Installs the package in a system that has nothing else: Debian, as debootstrap makes it. Starts the program there as a
# desktop does, by the type of a file, and waits until its points are on the screen of a virtual X server. Needs root,
# debootstrap, and a mirror of Debian that it finds. `cargo xtask package --try` starts it.
#
# bare_system.sh PACKAGE.deb FOLDER: the folder is where the system is made; it is made anew, unless it is there already.
set -eu
package=$1
system=$2
suite=${GLINT_BARE_SUITE:-bookworm}

if [ ! -x "$system/usr/bin/gio" ]; then
    debootstrap --variant=minbase --include=xvfb,libglib2.0-bin "$suite" "$system"
fi
# What a desktop has; the package itself asks for the rest.
cp "$package" "$system/tmp/glint.deb"
inside() { chroot "$system" env -i PATH=/usr/sbin:/usr/bin:/sbin:/bin HOME=/srv LC_ALL=C.UTF-8 DEBIAN_FRONTEND=noninteractive "$@"; }
mount --bind /dev "$system/dev"
mount -t proc proc "$system/proc"
trap 'umount -l "$system/proc" "$system/dev"' EXIT
inside apt-get -q -q update
# A folder that was there already may have another build of the same version. There is no terminal for a log.
inside apt-get -q -q -y -o Dpkg::Use-Pty=0 install --reinstall /tmp/glint.deb > /dev/null
inside dpkg -s glint | grep '^Status'
inside glint --version

# A file of three points, which only its content and its name identify.
inside sh -c 'printf "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nend_header\n0 0 0\n1 0 0\n0 1 0\n" > /srv/three.ply'
type=$(inside gio info -a standard::content-type /srv/three.ply | sed -n 's/.*content-type: //p')
echo "three.ply is of the type $type"
inside gio mime "$type" | grep -q 'glint.desktop' || { echo "no program is registered for $type"; exit 1; }

inside sh -c '
    mkdir -p -m 700 /tmp/runtime
    rm -f /tmp/events.jsonl /tmp/display
    # The server picks a free display and writes its number.
    Xvfb -displayfd 1 -screen 0 1280x1024x24 -nolisten tcp > /tmp/display 2> /dev/null &
    server=$!
    while [ ! -s /tmp/display ]; do sleep 1; done
    export XDG_RUNTIME_DIR=/tmp/runtime DISPLAY=:$(cat /tmp/display) GLINT_EVENT_LOG=/tmp/events.jsonl
    gio open /srv/three.ply
    for second in $(seq 240); do
        if grep -q "\"event\":\"frame\"" /tmp/events.jsonl 2> /dev/null; then
            grep -m 1 "\"event\":\"loaded\"" /tmp/events.jsonl
            echo "shown after $second s"
            # The program ends with the screen.
            kill $server
            sleep 2
            exit 0
        fi
        sleep 1
    done
    echo "nothing is shown"
    cat /tmp/events.jsonl
    kill $server
    exit 1
'
