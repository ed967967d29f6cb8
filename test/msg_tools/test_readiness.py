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

from types import SimpleNamespace

from msg_tools.readiness import GraphReports, parse, unmatched, unreceived


def status(**rows):
    """A DiagnosticStatus with one topic: publishes=2 gives the row 'publishes /t'."""
    return SimpleNamespace(level=b'\0', message='ok', values=[
        SimpleNamespace(key=f'{kind} /t', value=str(value)) for kind, value in rows.items()])


def test_parse_takes_endpoint_counts_only():
    rows = status(publishes=2, subscribes=1, published=7, received=5, last=9, gaps=3)
    rows.values += [SimpleNamespace(key='rate /t [Hz]', value='1.0'),
                    SimpleNamespace(key='last word', value='no number'),
                    SimpleNamespace(key='last /t', value='9' * 5000),
                    SimpleNamespace(key='', value='')]
    assert parse(rows) == {'publishes': {'/t': 2}, 'subscribes': {'/t': 1},
                           'published': {'/t': 7}, 'last': {'/t': 9}, 'rests': False,
                           'awaited': 0, 'errors': ''}
    rows.values += [SimpleNamespace(key='rests', value='True'),
                    SimpleNamespace(key='awaited', value='2')]
    assert parse(rows)['rests'] and parse(rows)['awaited'] == 2


def test_complete_when_both_sides_see_each_other():
    reports = {'a': parse(status(publishes=2)), 'b': parse(status(subscribes=1)),
               'c': parse(status(subscribes=1))}
    assert unmatched('abc', reports) == []


def test_a_node_that_is_not_there_is_missing():
    assert unmatched(['a', 'b'], {'a': parse(status())}) == ['node b']


def test_each_side_alone_is_not_enough():
    late = {'a': parse(status(publishes=0)), 'b': parse(status(subscribes=1))}
    assert unmatched('ab', late) == ['a to see 1 more subscribers of /t']
    late = {'a': parse(status(publishes=1)), 'b': parse(status(subscribes=0))}
    assert unmatched('ab', late) == ['b to see 1 more publishers of /t']


def test_topics_without_another_side_do_not_hold_up():
    assert unmatched('a', {'a': parse(status(publishes=0))}) == []
    # the other end belongs to a node that is not wanted
    reports = {'a': parse(status(publishes=0)), 'b': parse(status(subscribes=0))}
    assert unmatched('a', reports) == []


def test_unreceived_counts_by_the_publishers_number():
    then = {'a': parse(status(published=9)), 'log': parse(status(last=0))}
    now = {'a': parse(status(published=30)), 'log': parse(status(last=7))}
    assert unreceived('log', now, then) == {'/t': 2}
    now['log'] = parse(status(last=9))
    assert unreceived('log', now, then) == {}


def test_unreceived_leaves_out_what_the_receiver_does_not_take():
    then = {'a': parse(status(published=9))}
    assert unreceived('log', {'log': parse(status())}, then) == {}
    # and what it publishes itself
    then = {'log': parse(status(published=9))}
    assert unreceived('log', {'log': parse(status(last=0))}, then) == {}


def test_reports_are_the_last_of_each_node():
    def array(**nodes):
        return SimpleNamespace(status=[
            SimpleNamespace(name=name, **vars(status(publishes=count)))
            for name, count in nodes.items()])
    reports = GraphReports('/m')
    assert unmatched(['/m/a'], reports) == ['node /m/a']
    reports.take(array(**{'/m/a': 1, '/m/b': 2, '/m2/a': 7}))
    then = dict(reports)
    reports.take(array(**{'/m/b': 3, '/m2/b': 8}))
    # those of another mount are not heard
    assert {name: report['publishes']['/t'] for name, report in reports.items()} == {
        '/m/a': 1, '/m/b': 3}
    # a report that came since is another object
    assert [name for name in reports if reports[name] is not then[name]] == ['/m/b']


def test_errors_of_a_node_are_there_as_long_as_it_reports_them():
    reports = GraphReports('/m')
    assert reports.errors_of('log') == ''
    for level, text, wanted in ((b'\1', 'slow', ''), (b'\2', 'disk full', 'disk full'),
                                (b'\0', 'ok', '')):
        reports.take(SimpleNamespace(status=[SimpleNamespace(
            name='/m/log', level=level, message=text, values=[])]))
        assert reports.errors_of('log') == wanted
