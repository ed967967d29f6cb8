"""The command ``recover``: a new log from whatever can be read of a damaged one."""

from pathlib import Path

from . import options


def add(commands):
    """Add the parser."""
    parser = commands.add_parser(
        'recover', help='make a whole log of what can be read of a damaged one',
        description='Write what can be read of a log into a new one, with index, statistics and '
        'metadata, and say what was lost. The damaged log is only read.')
    parser.add_argument('log', type=options.log_path, metavar='BAG')
    parser.add_argument('--out', type=Path, metavar='DIR',
                        help='folder of the new log (default: BAG_recovered)')
    options.add_json(parser, 'what was saved and lost')
    options.add_overwrite(parser)


def run(args):
    """Recover and print."""
    from .console import new_console, print_lines, write_outputs
    options.check_target(args.json)
    report = recover_log(args.log, args.out)
    console = new_console()
    print_lines(console, 'lost', report['lost'])
    console.print(f'{report["messages"]} messages of {report["topics"]} topics saved, '
                  f'{report["lost_bytes"]} bytes lost: {report["out"]}', soft_wrap=True)
    write_outputs(console, (args.json, lambda p: options.write_json(p, report), 'result'))


def recover_log(bag, out=None, compression='zstd'):
    """Write all that can be read of a log into a new one, with index, statistics and metadata.

    Parameters
    ----------
    bag : str or Path
        A folder or an ``.mcap`` file; it is only read.
    out : str or Path, optional
        Folder of the new log, which must not exist or be empty; ``<bag>_recovered`` by default.
    compression : {'zstd', 'lz4', 'none'}

    Returns
    -------
    dict
        ``out`` (Path), ``messages``, ``topics``, ``attachments``, ``lost_bytes`` and ``lost``,
        a line for all that could not be saved.

    Raises
    ------
    ValueError
        Nothing can be read, or `out` is in use or lies in the log.
    OSError
        It may not be read, or `out` not be written.
    """
    from msg_tools.bag import OWN_RECORD, BagReader, BagWriter
    from msg_tools.bag.writer import REPEATED_RECORD, STOPPED_RECORD
    bag = Path(bag)
    out = Path(out) if out is not None else bag.with_name(f'{bag.stem}_recovered')
    if bag.is_dir() and bag.resolve() in (out.resolve(), *out.resolve().parents):
        raise ValueError(f'{out} lies in the log itself; choose another folder with --out')
    reader = BagReader(bag)
    # what the new log writes by itself, or what tells of the old files
    own = ('rosbag2', OWN_RECORD, REPEATED_RECORD, STOPPED_RECORD)
    notes = []
    with BagWriter(out, metadata=reader.metadata.get(OWN_RECORD), compression=compression) as new:
        topics = [topic for topic in reader.topics if _add_topic(reader, new, topic, notes)]
        for name, data in reader.metadata.items():
            if name not in own:
                new.add_metadata(name, data)
        types = {topic.name: topic.type for topic in topics}
        for message in reader.messages(list(types)):
            if message.type == types[message.topic]:
                new.write(message.topic, message.data, min(message.log_time, 2**63 - 1),
                          min(message.publish_time, 2**63 - 1), message.sequence)
        saved = [info.name for info in reader.attachments
                 if _add_attachment(reader, new, info, notes)]
        count = new.message_count
    return {'out': out, 'messages': count, 'topics': len(topics), 'attachments': saved,
            'lost_bytes': sum(length for _, _, length in reader.lost),
            'lost': reader.problems + notes}


def _add_topic(reader, new, topic, notes):
    schema, encoding = reader.schema_of(topic.name, topic.type)
    if encoding != 'cdr':
        notes.append(f'{topic.name}: no messages of ROS 2, left out')
        return False
    try:
        new.add_foreign_topic(topic.name, topic.type, topic.qos, schema.data, topic.type_hash,
                              schema.encoding)
    except ValueError as error:
        notes.append(f'{error}: {topic.count} messages left out')
        return False
    return True


def _add_attachment(reader, new, info, notes):
    from msg_tools.bag.writer import plain_name
    try:
        plain_name(info.name)
        with open(info.file, 'rb') as stream:
            stream.seek(info.offset)
            new.add_attachment(info.name, info.media_type, stream.read(info.size))
    except ValueError as error:
        notes.append(f'{error}; left out')
        return False
    return True
