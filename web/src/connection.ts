// The socket to the program: reconnects by itself, waiting a little longer each time.
import { decodeBinary, decodeText, encodeCommand, type BinaryMessage, type Command, type TextMessage } from './protocol.ts';

export type Link = 'connecting' | 'open' | 'lost';

export interface Handlers {
  message(message: TextMessage | BinaryMessage): void;
  /** `wait` [s] until the next try when lost */
  link(link: Link, wait: number): void;
}

const FIRST_WAIT = 0.3;
const LONGEST_WAIT = 5;
/** The server closes a connection that says nothing for 30 s. */
const HEARTBEAT_MS = 10_000;

export class Connection {
  private socket: WebSocket | null = null;
  private wait = FIRST_WAIT;
  private timer = 0;
  private heartbeat = 0;
  private closed = false;
  private unanswered: number[] = [];
  private lastStep = 0;

  constructor(
    private readonly url: string,
    private readonly handlers: Handlers,
  ) {
    this.open(true);
  }

  private open(first: boolean): void {
    this.handlers.link(first ? 'connecting' : 'lost', 0);
    const socket = new WebSocket(this.url);
    socket.binaryType = 'arraybuffer';
    this.socket = socket;
    socket.onopen = () => {
      this.wait = FIRST_WAIT;
      this.unanswered = [];
      this.handlers.link('open', 0);
      this.heartbeat = window.setInterval(() => this.send({ type: 'ack', frame: this.lastStep }), HEARTBEAT_MS);
    };
    socket.onmessage = ({ data }: MessageEvent<unknown>) => {
      const message =
        typeof data === 'string' ? decodeText(data) : data instanceof ArrayBuffer ? decodeBinary(data) : null;
      if (!message) return;
      if (message.type === 'frame') {
        this.lastStep = message.step;
        this.unanswered.push(message.step);
      }
      this.handlers.message(message);
    };
    socket.onclose = () => {
      window.clearInterval(this.heartbeat);
      if (this.closed || this.socket !== socket) return;
      this.handlers.link('lost', this.wait);
      this.timer = window.setTimeout(() => this.open(false), this.wait * 1000);
      this.wait = Math.min(LONGEST_WAIT, this.wait * 1.7);
    };
  }

  /** Tells the server that what has come has been drawn. */
  acknowledge(): void {
    for (const frame of this.unanswered) this.send({ type: 'ack', frame });
    this.unanswered.length = 0;
  }

  /** False where it could not be sent. */
  send(command: Command): boolean {
    if (this.socket?.readyState !== WebSocket.OPEN) return false;
    const message = encodeCommand(command);
    if (message === null) return false;
    this.socket.send(message);
    return true;
  }

  close(): void {
    this.closed = true;
    window.clearTimeout(this.timer);
    window.clearInterval(this.heartbeat);
    this.socket?.close();
  }
}
