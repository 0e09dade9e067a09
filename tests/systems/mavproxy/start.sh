# Usage: start.sh PORT FOLDER. MAVProxy catches what its modules raise, and prints it on stdout if it is asked to.
# Its user asks for the mission, for the rate of a stream and for a calibration of the compasses.
export HOME="$2" PYTHONUNBUFFERED=1 PYTHONDONTWRITEBYTECODE=1
exec "$RIOT_MAVLINK_PYTHON" "$(dirname "$RIOT_MAVLINK_PYTHON")/mavproxy.py" --master="tcp:127.0.0.1:$1" --moddebug=4 \
    --no-state --non-interactive --load-module=messagerate,heliplane --cmd="repeat add 1 wp list" \
    --cmd="repeat add 1 messagerate get ATTITUDE" --cmd="repeat add 3 magcal start" 1>&2
