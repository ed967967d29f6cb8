# Copyright 2026 telescope_mount developers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Reports of `recover` on damaged logs, compared with the true losses.

Logs of known messages are damaged at random (bytes changed, zeroed, removed or inserted, the end
cut off; in chunks, headers, message indexes, summary), recovered, and compared:

    python benchmarks/recover_truth.py --logs 500

`silent`: messages are lost but the log is reported complete. `wrong`: the reported number of lost
messages is wrong. `altered`: a message was recovered that was never written. All three must be 0.
"""

import argparse
import random
import shutil
import struct
import tempfile
from collections import Counter
from pathlib import Path

from msg_tools.bag import BagReader, BagWriter
from msg_tools.bag.log_copy import recover_log

TEXT = 'std_msgs/msg/String'
START = 1_768_482_000_000_000_000
KINDS = ('bit', 'byte', 'zeros', 'cut out', 'put in', 'end', 'two', 'summary', 'tail')
COMPRESSIONS = ('zstd', 'lz4', 'none')


def write(folder, compression):
    """A log of 900 messages of three topics in some thirty chunks."""
    rng = random.Random(compression)
    with BagWriter(folder, compression=compression, chunk_size=3000) as log:
        for name in ('/a', '/b', '/c'):
            log.add_foreign_topic(name, TEXT, [], b'string data\n', '')
        log.add_metadata('parameters /mount/x', {'n': 1})
        for i in range(900):
            text = b'%d ' % i + rng.randbytes(rng.randrange(40)).hex().encode()
            log.write('/' + 'abbccc'[i % 6],
                      b'\0\1\0\0' + struct.pack('<I', len(text) + 1) + text + b'\0',
                      START + i * 10**7, START + i * 10**7, i)
        log.add_attachment('model.json', 'application/json', b'{}')
    return folder


def damage(data, kind, rng):
    """`data` with damage of a kind somewhere."""
    data = bytearray(data)
    place = rng.randrange(8, len(data) - 8)
    if kind == 'bit':
        data[place] ^= 1 << rng.randrange(8)
    elif kind == 'byte':
        data[place] = rng.randrange(256)
    elif kind == 'zeros':
        size = rng.choice((4, 64, 512, 4096))
        data[place:place + size] = bytes(len(data[place:place + size]))
    elif kind == 'cut out':
        del data[place:place + rng.choice((1, 10, 500, 4096))]
    elif kind == 'put in':
        data[place:place] = rng.randbytes(rng.choice((1, 10, 500)))
    elif kind == 'end':
        del data[place:]
    elif kind == 'two':
        return damage(damage(data, 'byte', rng), rng.choice(('byte', 'bit', 'zeros')), rng)
    elif kind == 'summary':
        return damage(data[:-37], 'byte', rng) + data[-37:] if rng.random() < 0.3 else (
            damage(data[:-200] + bytes(50) + data[-150:], 'byte', rng))
    else:
        return damage(data[:-rng.choice((1, 8, 37, 60, 400))], 'byte', rng)
    return data


def judge(file, before, scratch):
    """The wrong statement of a recovery, '' for none; and its report."""
    report = recover_log(file, scratch)
    after = Counter((row.topic, row.log_time, row.data) for row in BagReader(scratch).messages())
    gone = before - after
    if after - before:
        return 'altered', report
    if gone and report['whole']:
        return 'silent', report
    if report['all_known'] and report['messages_lost'] != sum(gone.values()):
        return 'wrong', report
    if report['all_known'] and sum(report['missing'].values()) == report['messages_lost']:
        by_topic = Counter(row[0] for row in gone.elements())
        if by_topic != Counter(report['missing']):
            return 'wrong', report
    if report['messages_lost'] > sum(gone.values()):
        return 'wrong', report
    return '', report


def main():
    """Damage, recover, print."""
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('--logs', type=int, default=500)
    parser.add_argument('--seed', type=int, default=1)
    parser.add_argument('--keep', type=Path, help='folder for what was judged wrongly')
    args = parser.parse_args()
    rows = {kind: Counter() for kind in KINDS}
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        whole = {c: write(folder / c, c) for c in COMPRESSIONS}
        before = {c: Counter((m.topic, m.log_time, m.data) for m in BagReader(f).messages())
                  for c, f in whole.items()}
        for number in range(args.logs):
            rng = random.Random(f'{args.seed} {number}')
            compression, kind = rng.choice(COMPRESSIONS), KINDS[number % len(KINDS)]
            victim, scratch = folder / 'victim', folder / 'out'
            for used in (victim, scratch):
                shutil.rmtree(used, ignore_errors=True)
            shutil.copytree(whole[compression], victim)
            file = next(victim.glob('*.mcap'))
            file.write_bytes(damage(file.read_bytes(), kind, rng))
            if rng.random() < 0.5:
                (victim / 'metadata.yaml').unlink()
            count = rows[kind]
            count['logs'] += 1
            try:
                wrong, report = judge(victim, before[compression], scratch)
            except ValueError:
                count['refused'] += 1
                continue
            count[wrong] += bool(wrong)
            count['lossless'] += report['whole']
            count['counted'] += not report['whole'] and report['all_known']
            count['at least'] += not report['all_known']
            if wrong and args.keep:
                shutil.rmtree(args.keep / str(number), ignore_errors=True)
                shutil.copytree(victim, args.keep / str(number))
                print(number, compression, kind, wrong, {
                    k: report[k] for k in ('messages', 'messages_lost', 'missing', 'all_known',
                                           'parts', 'lost')})
    columns = ('logs', 'refused', 'lossless', 'counted', 'at least', 'silent', 'wrong', 'altered')
    print(f'{"damage":<10}' + ''.join(f'{name:>10}' for name in columns))
    for kind, count in rows.items():
        print(f'{kind:<10}' + ''.join(f'{count[name]:>10}' for name in columns))
    return sum(rows[kind][name] for kind in KINDS for name in ('silent', 'wrong', 'altered'))


if __name__ == '__main__':
    raise SystemExit(bool(main()))
