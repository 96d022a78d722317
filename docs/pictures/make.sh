#!/bin/sh
# Takes the pictures of real scans anew, at the program's defaults but for the rays of mirrors in the office:
#
#     docs/pictures/make.sh GLINT DATA [NAME...]
#
# GLINT is the program, DATA the folder of scans that the tests read (GLINT_TEST_DATA), NAME a picture without its
# extension; without names it takes all. The picture of the window needs Xvfb and ImageMagick's `import`, the others
# ImageMagick's `convert`.
set -eu
glint=$(realpath "$1")
data=$(realpath "$2")
shift 2
pictures=$(cd "$(dirname "$0")" && pwd)
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
office="$data/terrestrial/indoor_office_tls_rgb_las14_pf7.laz"
avebury="$data/airborne/avebury_uk_als_merged_las12_pf1.laz"
lake="$data/airborne/topography_mountain_lake_las12_pf1.laz"

# view CLOUD EYE PIVOT
view() {
    printf 'clouds = ["%s"]\n[camera]\neye = [%s]\npivot = [%s]\nup = [0.0, 0.0, 1.0]\n' "$@"
}

# A chrome sphere and a plane mirror in the office.
mirrors() {
    cat <<END
[[mirrors]]
name = "chrome"
shape = "sphere"
position = [7.0, 2.2, 1.75]
size = 0.6
specular_intensity = 0.95
[[mirrors]]
name = "inspection"
shape = { plane = { height = 0.68 } }
position = [5.5, 4.1, 1.9]
rotation = [0.5, 0.5, 0.5, 0.5]
size = 0.8
specular_intensity = 0.95
END
}
in_office() {
    view "$1" "10.35, 2.95, 2.1" "5.5, 2.85, 2.0"
}
in_office "$office" > "$work/room.toml"
(in_office "$office" && mirrors) > "$work/office.toml"
(in_office "$data/ply/indoor_office_tls_rgb_third_binary_le.ply" && mirrors) > "$work/window.toml"
view "$avebury" "414250.0, 177900.0, 360.0" "414450.0, 178280.0, 172.0" > "$work/farm.toml"
view "$lake" "273335.0, 5274450.0, 828.0" "273385.0, 5274444.0, 803.0" > "$work/lake.toml"
view "$data/airborne/autzen_trim_las12_pf3.las" "636300.0, 848500.0, 900.0" "636560.0, 849190.0, 430.0" \
    > "$work/river.toml"
cat >> "$work/lake.toml" <<END
[[mirror_points]]
cloud = "$lake"
points = { class = 9 }
normals = "flatten"
specular_intensity = 0.8
END

# render NAME SIZE WORD...
render() {
    name=$1 size=$2
    shift 2
    "$glint" render "$@" -o "$work/$name.png" --size "$size"
    convert "$work/$name.png" -quality 88 "$pictures/$name.jpg"
}

take() {
    case $1 in
    office) render office 1280x720 "$work/office.toml" --set reflection.samples=16 ;;
    office_colors) render office_colors 960x540 "$work/room.toml" ;;
    office_lit) render office_lit 960x540 "$work/room.toml" --set light.by=surroundings --bounces 3 ;;
    avebury_colors) render avebury_colors 960x540 "$work/farm.toml" --set light.by=colors ;;
    avebury_lit) render avebury_lit 960x540 "$work/farm.toml" ;;
    lake) render lake 1280x460 "$work/lake.toml" ;;
    overlays)
        render overlays 900x480 "$work/river.toml" --set overlay.scale_bar=true --set overlay.legend=true \
            --set overlay.north=true --set overlay.axes=true --set overlay.text=15 --set color.by=height
        ;;
    bunny) render bunny 640x400 "$data/ply/stanford_bunny_full_ascii_mesh.ply" ;;
    courtyard) render courtyard 1280x640 courtyard/pool --set reflection.samples=9 ;;
    surfaces_ends) surfaces_ends ;;
    thrown) thrown ;;
    window) window ;;
    *) echo "no picture $1" >&2 && exit 2 ;;
    esac
}

# The box with a mirror ball: left without the light that the ball throws, right with it.
thrown() {
    for photons in 0 16384; do
        "$glint" render five-mirrors/sphere -o "$work/thrown.$photons.png" --size 560x420 --bounces 3 \
            --set "light.photons=$photons" --set tone.exposure=1
    done
    convert "$work/thrown.0.png" "$work/thrown.16384.png" +append -quality 84 "$pictures/thrown.jpg"
}

# A made street near its floor, and the far end of the office: left full radii, right the defaults.
surfaces_ends() {
    view "tripod/street" "31.0, 6.0, 0.35" "38.0, 6.6, 0.5" > "$work/street.toml"
    view "$office" "13.0, 3.0, 1.7" "5.5, 4.4, 1.7" > "$work/end.toml"
    for name in street end; do
        "$glint" render "$work/$name.toml" -o "$work/$name.full.png" --size 640x360 --set surface.radii=full \
            --set surface.carve=false --set edl.ignored=0 --set splat.rest_pixels=1 --set color.blank=black
        "$glint" render "$work/$name.toml" -o "$work/$name.png" --size 640x360
        convert "$work/$name.full.png" "$work/$name.png" +append "$work/$name.pair.png"
    done
    convert "$work/street.pair.png" "$work/end.pair.png" -append -quality 80 "$pictures/surfaces_ends.jpg"
}

# The window, with the sphere selected by a click, and its numbers in the tab Mirrors. On a larger screen the window has
# the size that it opens with.
window() {
    Xvfb :87 -screen 0 1400x900x24 2> /dev/null &
    screen=$!
    until DISPLAY=:87 xdotool getmouselocation > /dev/null 2>&1; do sleep 1; done
    GLINT_EVENT_LOG="$work/log" XDG_CONFIG_HOME="$work" DISPLAY=:87 "$glint" "$work/window.toml" &
    viewer=$!
    await settled
    DISPLAY=:87 xdotool mousemove 745 400 click 1
    await selected
    DISPLAY=:87 xdotool mousemove 119 45 click 1
    # The selection and the tab are painted at once.
    sleep 2
    DISPLAY=:87 import -window root -crop 1280x800+0+0 +repage "$work/window.png"
    kill "$viewer" && wait "$viewer" || true
    kill "$screen"
    convert "$work/window.png" -quality 88 "$pictures/window.jpg"
}

# Waits until the window has logged an event, or has gone.
await() {
    while kill -0 "$viewer" && ! grep -q "\"event\":\"$1\"" "$work/log" 2> /dev/null; do sleep 1; done
}

[ $# -gt 0 ] || set -- office office_colors office_lit avebury_colors avebury_lit lake overlays bunny courtyard surfaces_ends thrown window
for name; do
    take "$name"
done
