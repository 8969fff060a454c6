// Where a body is attached: its surface is tinted there, under the handle's red.
import type { AttachmentInfo, BodyInfo } from './protocol.ts';

export const TIED_KINDS = ['fixed', 'springs', 'glued'] as const;

/** Of each node how much it is attached, one number a kind. */
export function tiedNodes(attachments: readonly AttachmentInfo[], count: number): Float32Array {
  const tied = new Float32Array(TIED_KINDS.length * count);
  for (const { kind, nodes } of attachments) {
    for (const node of nodes) {
      if (node < count) tied[TIED_KINDS.length * node + TIED_KINDS.indexOf(kind)] = 1;
    }
  }
  return tied;
}

/** Whether the tool is joined to something but its handle: it cannot be drawn elsewhere than what it is joined to. */
export function toolIsTied(bodies: readonly BodyInfo[]): boolean {
  const tool = bodies.find((b) => b.kind === 'tool');
  if (!tool) return false;
  return tool.attachments.length > 0 || bodies.some((b) => b.attachments.some((a) => a.to === tool.name));
}
